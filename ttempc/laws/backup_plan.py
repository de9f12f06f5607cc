"""Backup plan: the last plan of the MPC, kept by its ancillary gain where a QP has no solution.

    u_e = ubar_j + K m,    m = zhat - zbar_j.

zbar_j follows the model from the estimate at which the plan was made, with the disturbances of now.
ubar_j are the planned inputs; after a first input that the robust action has moved away they
approach the plan at the rate that the tightening leaves, and K m saturates at its reserve.
"""

from __future__ import annotations

from ..jit import cached_njit, record
from ..mpc.condensing import Stages, Work
from ..types import FloatArray
from .law_records import BACKUP, ERRORS, GAIN_SCHEDULE, INPUTS, MEMORY, STATES, Law
from .robust_action import advance


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def can_follow_plan(k: int, law: Law, memory: FloatArray) -> bool:
    """Whether there is a plan with a stage for tick `k` that was followed up to the last tick."""
    s = record(memory, MEMORY)
    return s.followed_tick == k - 1 and k - int(s.plan_tick) < law.reserve.shape[0]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def follow_plan(k: int, law: Law, stages: Stages, work: Work, memory: FloatArray) -> None:
    """Write feedback -ubar_j and action -K m of tick `k` by the backup plan."""
    s = record(memory, MEMORY)
    ancillary = record(law.schedule[k], GAIN_SCHEDULE).ancillary
    bounds = stages.bounds
    plan_tick = int(s.plan_tick)
    stage = k - plan_tick
    s.fallback = BACKUP
    s.followed_tick = k
    advance(k - 1, stages, s.plan_error, s.plan_input, s.next_nominal)

    first = INPUTS * min(stage, work.steps.size // INPUTS - 1)  # its last step up to this stage
    for i in range(INPUTS):
        planned = work.backup_previous[i]
        for step in range(i, first + i + 1, INPUTS):
            planned += work.backup_steps[step]
        lower = s.plan_input[i] + bounds.step_lower[plan_tick, first + i]
        upper = s.plan_input[i] + bounds.step_upper[plan_tick, first + i]
        s.plan_input[i] = min(max(planned, lower), upper)
        s.feedback[i] = s.plan_input[i]

        action = 0.0
        for j in range(STATES):
            action += ancillary[i, j] * (work.state[j] - s.next_nominal[j])
        reserve = law.reserve[stage, k, i]
        s.action[i] = -min(max(action, -reserve), reserve)

    for i in range(ERRORS):
        s.plan_error[i] = s.next_nominal[i] if i < STATES else work.state[i]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def keep_within_bounds(k: int, stages: Stages, memory: FloatArray) -> None:
    """Saturate the robust action where the sum leaves the range of all later plans."""
    s = record(memory, MEMORY)
    bounds = stages.bounds
    for i in range(INPUTS):
        lower = max(bounds.lower[k, i], s.previous[i] + bounds.step_lower[k, i])
        upper = min(bounds.upper[k, i], s.previous[i] + bounds.step_upper[k, i])
        s.total[i] = max(min(s.total[i], upper), lower)
        s.action[i] = s.feedback[i] - s.total[i]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def remember_plan(k: int, work: Work, memory: FloatArray) -> None:
    """Keep the accepted plan of tick `k`."""
    s = record(memory, MEMORY)
    s.plan_tick = k
    s.followed_tick = k
    for i in range(INPUTS):
        s.plan_input[i] = s.total[i]
        work.backup_previous[i] = work.previous[i]
    for i in range(work.steps.size):
        work.backup_steps[i] = work.steps[i]
    for i in range(ERRORS):
        s.plan_error[i] = work.state[i]
