"""Tube MPC of a double integrator: the example of Mayne, Seron and Rakovic (2005).

    python docs/examples/double_integrator.py [FIGURE.png]

x(k+1) = [[1, 1], [0, 1]] x(k) + [0.5, 1]' u(k) + w(k) with x_2 <= 2, |u| <= 1, |w| <= 0.1 in each
entry, Q = I, R = 0.01, N = 9 and x(0) = (-5, -2). Prints gain, tube, tightened bounds and terminal
set, then drives the MPC under random and under extreme disturbances.
"""

import sys

import numpy as np
import piqp
from scipy.linalg import solve_discrete_are
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from ttempc.tube import (
    DisturbanceSet,
    SupportSet,
    TrackingSystem,
    feedback_gains,
    invariant_tube,
    minkowski_sum,
    outline,
)

A, B = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.5], [1.0]])
Q, R = np.eye(2), np.array([0.01])
W = DisturbanceSet(0.1 * np.eye(2), shape="box")
# F (x_1, x_2, u) <= f
NORMALS = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
OFFSETS = np.array([2.0, 1.0, 1.0])
HORIZON, START, STEPS = 9, np.array([-5.0, -2.0]), 20


def reach(normals, offsets, directions):
    """Return the largest value of each of the directions on {x : normals x <= offsets}."""
    bounds = (None, None)
    programmes = [linprog(-row, normals, offsets, bounds=bounds) for row in directions]
    return np.array([np.inf if one.status == 3 else -one.fun for one in programmes])


def terminal_set(closed, normals, offsets):
    """Return the largest subset that x+ = closed x never leaves (Gilbert and Tan 1991)."""
    all_normals, all_offsets, rows = normals, offsets, normals
    while True:
        rows = rows @ closed
        new = reach(all_normals, all_offsets, rows) > offsets + 1e-9
        if not new.any():
            return all_normals, all_offsets
        all_normals = np.vstack([all_normals, rows[new]])
        all_offsets = np.concatenate([all_offsets, offsets[new]])


class TubeMpc:
    """Nominal MPC in tightened constraints; its first nominal state is a decision variable."""

    def __init__(self):
        self.gain = feedback_gains(A[None], B[None], Q, R)[0]
        self.tube = invariant_tube(TrackingSystem.along(A[None], B[None], self.gain[None]), W, 1e-3)
        on_both = np.vstack([np.eye(2), self.gain])  # (z, K z)
        self.left = OFFSETS - self.tube.at(0).support(NORMALS @ on_both)  # tightened
        self.final = terminal_set(A + B @ self.gain, NORMALS @ on_both, self.left)
        self.terminal = SupportSet(2, lambda directions: reach(*self.final, directions))
        certificate = self.tube.certificate
        terms = [self.tube.transition(0, i) @ W.axes for i in range(certificate.terms)]
        self.generators = np.hstack(terms) / (1.0 - certificate.alpha)  # {G y : |y| <= 1}
        self.solver = piqp.DenseSolver()
        self._pose()

    def _pose(self):
        """Set up the QP over (z_0, v_0), ..., (z_{N-1}, v_{N-1}), z_N, y with x = z_0 + G y."""
        stage, g = 3, self.generators.shape[1]
        states = stage * HORIZON + 2
        size = states + g
        p, equal = np.zeros((size, size)), np.zeros((2 * HORIZON + 2, size))
        value = solve_discrete_are(A, B, Q, np.diag(R))
        normals, (final, at_end) = NORMALS, self.final
        bounded = np.zeros((HORIZON * len(normals) + len(final), size))
        for k in range(HORIZON):
            at = stage * k
            p[at : at + 3, at : at + 3] = np.diag([1.0, 1.0, R[0]])
            equal[2 * k : 2 * k + 2, at : at + 5] = np.hstack([A, B, -np.eye(2)])
            bounded[len(normals) * k : len(normals) * (k + 1), at : at + 3] = normals
        p[states - 2 : states, states - 2 : states] = value
        equal[-2:, :2], equal[-2:, states:] = np.eye(2), self.generators
        bounded[HORIZON * len(normals) :, states - 2 : states] = final
        upper = np.concatenate([np.tile(self.left, HORIZON), at_end])
        free = np.full(states, np.inf)
        box = np.concatenate([free, np.ones(g)])
        self.equal = np.zeros(2 * HORIZON + 2)
        self.solver.setup(
            p, np.zeros(size), equal, self.equal, bounded, None, upper, x_l=-box, x_u=box
        )

    def step(self, x):
        """Return the input and the nominal state z_0 at the state x."""
        self.equal[-2:] = x
        self.solver.update(b=self.equal)
        if self.solver.solve() != piqp.PIQP_SOLVED:
            raise ValueError(f"infeasible at {x}")
        z, v = np.split(self.solver.result.x[:3].copy(), [2])
        return v + self.gain @ (x - z), z


def drive(mpc, disturbances):
    """Return states (k + 1, 2), inputs (k, 1) and nominal states (k, 2)."""
    states, inputs, nominal = [START], [], []
    for w in disturbances:
        u, z = mpc.step(states[-1])
        inputs.append(u)
        nominal.append(z)
        states.append(A @ states[-1] + B @ u + w)
    return np.array(states), np.array(inputs), np.array(nominal)


def main():
    """Print the sets, then the extremes of 200 runs."""
    mpc = TubeMpc()
    print("K", mpc.gain[0].round(4))
    certificate, half = mpc.tube.certificate, mpc.tube.states[0]
    print(f"Z: alpha {certificate.alpha:.1e} after {certificate.terms} terms, +-", half.round(4))
    upper, above, below = mpc.left
    print(f"z_2 at most {upper:.4f}, v between {-below:.4f} and {above:.4f}")
    corners = ConvexHull(outline(mpc.terminal, np.eye(2), 720)).points
    low, high = corners.min(axis=0).round(2), corners.max(axis=0).round(2)
    print(f"X_f: {len(mpc.final[0])} half-spaces, from {low} to {high}")
    generator = np.random.default_rng(1)
    runs = [drive(mpc, generator.uniform(-0.1, 0.1, (STEPS, 2))) for _ in range(100)]
    runs += [drive(mpc, 0.1 * np.sign(generator.normal(size=(STEPS, 2)))) for _ in range(100)]
    last = max(np.abs(x[-1] / half).max() for x, _, _ in runs)
    print(
        f"{len(runs)} runs: largest x_2 {max(x[:, 1].max() for x, _, _ in runs):.3f}, "
        f"largest |u| {max(np.abs(u).max() for _, u, _ in runs):.3f}, "
        f"last state over the half widths of Z {last:.3f}"
    )
    if len(sys.argv) > 1:
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots()
        tube = mpc.tube.at(0)
        both = minkowski_sum([mpc.terminal, tube])
        axes.fill(*outline(both, np.eye(2)).T, color="0.9")
        axes.fill(*outline(mpc.terminal, np.eye(2)).T, color="0.75")
        states, _, nominal = runs[0]
        for z in nominal:
            axes.fill(*(z + outline(tube, np.eye(2))).T, facecolor="none", edgecolor="tab:green")
        axes.plot(*states.T, ".-", color="black")
        axes.axhline(2.0, color="tab:red", linestyle="--")
        axes.set(xlabel="x_1", ylabel="x_2")
        figure.savefig(sys.argv[1])


if __name__ == "__main__":
    main()
