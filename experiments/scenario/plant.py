"""`[plant]` and `[control]`: simulated vehicle, rate of the control loop and of the records."""

import math
from typing import Annotated, Final

from pydantic import Field
from pydantic.dataclasses import dataclass

from ...testbed.configuration.config_io import STRICT
from ...testbed.discretisation import whole_steps
from ...testbed.simulation.deadline import STEP_LIMIT_S
from ...testbed.wheels.soil_law import SoilLaw
from ..errors import InvalidScenario
from .vehicle import PlantVehicleSettings

PAPER_PERIOD_S: Final = 0.2
"""Control period of the paper, sec. II, and of the shipped tubes [s]."""
_RECORD_RATE_HZ: Final = 25.0  # of the truth at least: that of the paper's fastest sensors


@dataclass(frozen=True, config=STRICT)
class PlantSettings:
    """Simulated vehicle and method of simulation."""

    timestep_s: Annotated[float, Field(ge=0.0005, le=0.004)] = 0.002
    """Physics step."""
    wheel_law: SoilLaw = SoilLaw()
    """Coefficients of traction, motion resistance and side force on soil."""
    vehicle: PlantVehicleSettings = PlantVehicleSettings()
    """Parameters of the vehicle."""


@dataclass(frozen=True, config=STRICT)
class ControlSettings:
    """Rate and deadline of estimator and controller."""

    rate_hz: Annotated[float, Field(ge=5.0, le=100.0)] = 1.0 / PAPER_PERIOD_S
    """Commands per second; a period must be a whole number of physics steps."""
    realtime: bool = False
    """Whether the command of a step that took longer than its period acts as much later; such a
    run is not reproducible."""
    step_limit_s: Annotated[float, Field(ge=1.0, le=3600.0)] = STEP_LIMIT_S
    """Processor time after which a step that does not return ends the run as invalid; one that
    sleeps ends it after ten times as long."""
    resume_s: tuple[Annotated[float, Field(ge=0.0, le=1e6)], ...] = ()
    """Times at which an operator lets a stopped vehicle drive on, see `Guidance.resume`."""

    @property
    def period_s(self) -> float:
        """Control period [s]."""
        return 1.0 / self.rate_hz


def record_rate(timestep_s: float, period_s: float) -> float:
    """Return the default number of rows of the truth per second [Hz].

    It is the lowest from 25 Hz on with rows on control ticks and on physics steps.
    """
    steps = whole_steps(period_s, timestep_s, _period_name(timestep_s))
    counts = (n for n in range(1, steps + 1) if steps % n == 0)
    rates = [n / period_s for n in counts]
    return next((hz for hz in rates if hz >= _RECORD_RATE_HZ - 1e-9), rates[-1])


def record_steps(timestep_s: float, period_s: float, record_hz: float) -> int:
    """Return the physics steps from one row of the truth to the next."""
    control_steps = whole_steps(period_s, timestep_s, _period_name(timestep_s))
    rows = round(period_s * record_hz) if math.isfinite(record_hz) else 0
    exact = abs(rows - period_s * record_hz) < 1e-9
    if rows < 1 or not exact or control_steps % rows:
        allowed = (n / period_s for n in range(1, control_steps + 1))
        rates = [f"{hz:g}" for n, hz in enumerate(allowed, 1) if control_steps % n == 0]
        raise InvalidScenario(
            f"record rate: got {record_hz:g} Hz, must be one of {', '.join(rates)} Hz, so that "
            f"rows fall on physics steps of {1e3 * timestep_s:g} ms and on control ticks"
        )
    return control_steps // rows


def _period_name(timestep_s: float) -> str:
    return f"plant.timestep_s = {timestep_s}: control period"
