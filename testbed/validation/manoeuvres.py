"""Manoeuvres of the validation: what is driven on the bench, what is measured, what the law says.

Each takes a bench and yields a `Measured` for every row that the table in `validate.py` has of it,
in the order of the rows.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np
from scipy.optimize import curve_fit

from ttempc.types import Command, FloatArray

from ..ground.terrain import (
    Terrain,
    flat,
)
from ..simulation.plant import Plant
from ..truth import WHEELS
from ..vehicle.steering_coupling import couple_joints
from ..vehicle.vehicle import AxleLoads
from ..wheels import tyre
from .bench import (
    DRIVEN,
    FIRM_KPA,
    RELEASED,
    SPEED,
    STOP,
    TRAILER,
    Bench,
    bodies,
    centre_of_mass,
    column,
    drive,
    steps,
    wheel_motion,
    wheel_places,
)
from .check import Chart, Line
from .steady_motion import Planar, steady_motion

_UP_Y: Final = 0.5 * math.pi  # [rad] direction of a slope that rises to the north


class Measured(NamedTuple):
    """What a manoeuvre found for a row of the table.

    `figure` is None where the check does not apply; `note` then gives the reason.
    """

    figure: float | None
    law: Any = None  # what the band of the row is about, where that is not a constant
    note: str = ""
    chart: Chart | None = None
    words: Mapping[str, Any] = MappingProxyType({})  # that the name of the row leaves open


def _chart(title: str, x_label: str, y_label: str, x: FloatArray, **lines: FloatArray) -> Chart:
    """Return a chart of lines over x, the last one being the law; `_` in a label is a blank."""
    labels = tuple(lines)
    return Chart(
        title,
        x_label,
        y_label,
        tuple(
            Line(label.replace("_", " "), x, y, label != labels[-1]) for label, y in lines.items()
        ),
    )


# --- statics --------------------------------------------------------------------------------------

_SLOPE: Final = math.radians(10.0)
_STEEP: Final = math.radians(15.0)
_REST_S: Final = 5.0


def static_loads(bench: Bench) -> Iterator[Measured]:
    """Measure weight and axle loads on level ground; moments of the vehicle's file."""
    load = at_rest(bench.plant(flat((20.0, 20.0))))
    static = AxleLoads.of(bench.vehicle)
    expected = {"front": static.front, "rear": static.rear, "trailer": static.trailer}
    yield Measured(load.sum(), sum(expected.values()))
    for wheels, (axle, law) in zip(
        (~(DRIVEN | TRAILER), DRIVEN, TRAILER), expected.items(), strict=True
    ):
        yield Measured(load[wheels].sum(), law, words={"axle": axle})


def load_transfer(bench: Bench) -> Iterator[Measured]:
    """Measure the shift of the centre of the wheel loads at rest across a slope.

    Moments about the ground: h tan(slope) down the slope from the foot of the centre of mass, which
    is at the height h.
    """
    plant = bench.plant(flat((30.0, 20.0)).tilted(_SLOPE, _UP_Y))
    load = at_rest(plant)
    feet = tyre.contact(plant.tyres, plant.terrain, wheel_motion(plant)).point  # (6, 3) [m]
    uphill = np.array([0.0, math.cos(_SLOPE), math.sin(_SLOPE)])
    normal = np.array([0.0, -math.sin(_SLOPE), math.cos(_SLOPE)])
    centre = centre_of_mass(plant, bodies(plant, "tractor"))[1]
    shift = float(centre @ uphill - load @ (feet @ uphill) / load.sum())
    yield Measured(1e3 * shift, 1e3 * float(centre @ normal) * math.tan(_SLOPE))


def at_rest(plant: Plant, seconds: float = _REST_S) -> FloatArray:
    """Return the wheel loads at rest [N], after the tread deflections of settling have faded."""
    plant.reset(0.0, 0.0, 0.0, 0.0)
    return plant.advance(RELEASED, steps(plant, seconds)).wheels.load


def _mobility(plant: Plant, load: FloatArray, cone_index: float) -> tuple[FloatArray, FloatArray]:
    """Return the mobility numbers Bn and M of the wheels, both (6,)."""
    return tyre.mobility(plant.wheel_law, plant.tyres, load, np.full(len(WHEELS), cone_index))


def creep(bench: Bench) -> Iterator[Measured]:
    """Measure the displacement after 30 s at rest across a slope of 15 deg."""
    plant = bench.plant(flat((20.0, 20.0)).tilted(_STEEP, _UP_Y), bench.cone_index)
    before = plant.reset(0.0, 0.0, 0.0, 0.0)
    after = plant.advance(STOP, steps(plant, 30.0))
    pairs = (before.tractor, after.tractor), (before.trailer, after.trailer)
    yield Measured(1e3 * max(math.hypot(b.x - a.x, b.y - a.y) for a, b in pairs))


# --- drive and steering ---------------------------------------------------------------------------

_BUILD_UP_S: Final = 0.2  # in which motion resistance builds up over its relaxation length


def hydrostat_step(bench: Bench) -> Iterator[Measured]:
    """Measure gain and lag of the speed after a full hydrostat step on firm level ground."""
    gain = bench.nominal.speed_gain
    tau = bench.nominal.speed_time_constant
    plant = bench.plant(flat((120.0, 10.0)))
    plant.reset(-50.0, 0.0, 0.0, 0.0)
    truths = drive(plant, Command(0.0, 0.0, 1.0), 6.0 * tau, 0.05)
    time = column(truths, "time_s")
    speed = column(truths, "speed")

    def lag(t: np.ndarray, gain: float, tau: float) -> np.ndarray:
        return gain * (1.0 - np.exp(-t / tau))

    (found, lagged), _ = curve_fit(lag, time, speed, (1.0, 1.0))
    lines = {"plant": speed, "K (1 - exp(-t/tau))": lag(time, gain, tau)}
    chart = _chart("Hydrostat step", "time [s]", "speed [m/s]", time, **lines)
    yield Measured(found, gain, chart=chart)
    yield Measured(lagged, tau)


def coast_down(bench: Bench) -> Iterator[Measured]:
    """Measure the deceleration without drive: motion resistance over inertia.

    (m + sum I/r^2) dv/dt = -sum R, with R the motion resistance of each wheel without torque and I
    its inertia about the axle.
    """
    plant = bench.plant(flat((20.0, 20.0)), bench.cone_index)
    plant.reset(0.0, 0.0, 0.0, SPEED)
    plant.model.actuator("hydrostat").forcerange[:] = 0.0
    truths = drive(plant, STOP, 0.8, 0.02)
    time = column(truths, "time_s")
    speed = column(truths, "speed")
    load = np.mean(column(truths, "wheels.load"), axis=0)
    law = plant.wheel_law
    bn, _ = _mobility(plant, load, bench.cone_index)
    resistance = -float(load @ law.net_traction_ratio(bn, law.towed_slip(bn)))
    mass, _ = centre_of_mass(plant, bodies(plant, "tractor"))
    spin = np.array([_axle_inertia(plant, wheel) for wheel in WHEELS])
    expected = resistance / (mass + float((spin / plant.tyres.radius**2).sum()))
    late = (time > _BUILD_UP_S) & (speed > 0.1)
    title = f"Coast-down, {bench.cone_index:.0f} kPa"
    lines = {"plant": speed, "motion resistance": SPEED - expected * time}
    yield Measured(
        -float(np.polyfit(time[late], speed[late], 1)[0]),
        expected,
        chart=_chart(title, "time [s]", "speed [m/s]", time, **lines),
        words={"kpa": bench.cone_index},
    )


def _axle_inertia(plant: Plant, wheel: str) -> float:
    """Return the inertia of a wheel about its axle [kg m^2], the y axis of its body."""
    body = plant.model.body(wheel)
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, body.iquat)  # MuJoCo sorts the principal moments
    principal = float(axes.reshape(3, 3)[1] ** 2 @ body.inertia)
    return principal + float(plant.model.joint(wheel).armature[0])


_PLAIN: Final = "a plain trailer has no steering"
_BY_STEERING: Final = "d delta_i' cos delta_i"  # what steering adds to the trailer's yaw rate


def steering_steps(bench: Bench) -> Iterator[Measured]:
    """Measure rate, stop and lag of both steering angles for 1.5 rad, beyond both stops."""
    for name, letter in (("front steering", "t"), ("trailer steering", "i")):
        limit, rate, lag = (
            getattr(bench.nominal, f"steering_{key}_{letter}") for key in ("limit", "rate", "lag")
        )
        plant = bench.plant()
        every_s = plant.timestep_s * steps(plant, 0.01)
        plant.reset(0.0, 0.0, 0.0, 1.0)
        command = replace(bench.command(), **{f"delta_{letter}": 1.5})
        truths = drive(plant, command, limit / rate + 8.0 * lag, every_s)
        angle = column(truths, f"delta_{letter}")
        time = column(truths, "time_s")
        ideal = np.clip(np.degrees(rate * (time - lag)), 0.0, math.degrees(limit))
        lines = {"plant": np.degrees(angle), "rate, lag, stop": ideal}
        chart = _chart(f"Step of the {name}", "time [s]", "angle [deg]", time, **lines)
        middle = min(int(np.searchsorted(angle, 0.7 * limit)), len(angle) - 1)
        behind = time[middle] - angle[middle] / rate  # a lag trails a ramp by its time constant
        found = np.degrees([np.diff(angle).max() / every_s, angle[-1]])
        rated, stop = np.degrees([rate, limit])
        if limit:
            yield Measured(found[0], rated, chart=chart, words={"axis": name})
        else:
            yield Measured(None, words={"axis": name}, note=_PLAIN)
        yield Measured(found[1], stop, words={"axis": name})
        if limit:
            yield Measured(behind, lag, words={"axis": name})


# --- turning --------------------------------------------------------------------------------------

_RADII: Final = np.array([6.0, 8.0, 10.0, 14.0, 20.0])  # [m]
_STRENGTHS: Final = np.array([FIRM_KPA, 600.0, 300.0])  # [kPa]
_RADIUS: Final = 10.0  # [m] of turns on softer soil
_SETTLE: Final = 8.0  # lengths behind the pin: the transient has decayed to e^-8


def _turn(bench: Bench, radius: float, cone_index: float) -> tuple[float, float, float, float]:
    """Drive a circle at walking pace until it is steady.

    Returns:
        Yaw rate over Ackermann's v tan(delta) / L, the same by `steady_motion`, radius of the
        tractor point [m], by how much the trailer point cuts in [m].
    """
    wheelbase = bench.nominal.wheelbase
    plant = bench.plant(flat((50.0, 50.0)), cone_index)
    plant.reset(0.0, 0.0, 0.0, 0.0)
    planar = Planar.of(bench.nominal, plant)
    plant.reset(0.0, -radius, 0.0, SPEED)
    command = bench.command(delta_t=math.atan(wheelbase / radius))
    behind = bench.nominal.drawbar_length + bench.nominal.trailer_length
    plant.advance(command, steps(plant, _SETTLE * behind / SPEED))
    truths = drive(plant, command, 2.0, 0.05)
    names = ("delta_t", "yaw_rate_t", "speed", "lateral_speed", "yaw_rate_i")
    means = np.mean(np.column_stack([column(truths, name) for name in names]), axis=0)
    delta, yaw_rate, speed, lateral, trailer_rate = means
    load = np.mean(column(truths, "wheels.load"), axis=0)
    ackermann = speed * math.tan(delta) / wheelbase
    motion = steady_motion(planar, delta, speed, load, cone_index)
    apart = np.diff(column(truths, "trailer")[:, :2], axis=0)
    trailer_speed = float(
        np.linalg.norm(apart, axis=1).sum() / (truths[-1].time_s - truths[0].time_s)
    )
    turned = math.hypot(speed, lateral) / yaw_rate
    cut = turned - trailer_speed / trailer_rate
    return yaw_rate / ackermann, motion.yaw_rate / ackermann, turned, cut


def circles(bench: Bench) -> Iterator[Measured]:
    """Measure yaw rate and off-tracking on circles of 6 to 20 m on firm ground."""
    turns = np.array([_turn(bench, radius, FIRM_KPA) for radius in _RADII.tolist()])
    ratios, predicted, radii, measured = turns.T
    closed = np.array([off_tracking(bench, radius) for radius in radii.tolist()])
    lines = {"plant": ratios, "balance of forces": predicted}
    title = "Steady turning on firm ground"
    x_label = "radius by Ackermann [m]"
    yield Measured(ratios.min())
    yield Measured(ratios.max())
    yield Measured(
        np.abs(ratios - predicted).max(),
        chart=_chart(title, x_label, "yaw rate / Ackermann", _RADII, **lines),
    )
    worst = np.abs(measured - closed).argmax()
    lines = {"plant": measured, "closed form": closed}
    title = "Off-tracking, trailer unsteered"
    yield Measured(
        1e3 * abs(measured - closed).max(),
        note=f"worst at R = {_RADII[worst]:g} m: {measured[worst]:.3f} m, closed form "
        f"{closed[worst]:.3f} m",
        chart=_chart(title, x_label, "trailer inside tractor [m]", _RADII, **lines),
    )


def softening(bench: Bench) -> Iterator[Measured]:
    """Measure the loss of yaw rate by slip angles on one circle as the ground softens."""
    turns = [_turn(bench, _RADIUS, strength) for strength in _STRENGTHS.tolist()]
    ratios, predicted = np.array(turns).T[:2]
    lines = {"plant": ratios, "balance of forces": predicted}
    title = "Turning at R = 10 m on softer soil"
    x_label = "cone index [kPa]"
    yield Measured(
        ratios[0] - ratios[-1],
        predicted[0] - predicted[-1],
        chart=_chart(title, x_label, "yaw rate / Ackermann", _STRENGTHS, **lines),
        words={"firm": _STRENGTHS[0], "soft": _STRENGTHS[-1]},
    )
    yield Measured(-np.diff(ratios).max())


def off_tracking(bench: Bench, radius: float) -> float:
    """Return by how much an unsteered trailer cuts into a circle of a radius [m], both [m].

    The pin runs on a circle of radius sqrt(R^2 + a^2); the trailer's axle is tangent to its own
    circle.
    """
    vehicle = bench.nominal
    behind = vehicle.drawbar_length + vehicle.trailer_length
    return radius - math.sqrt(radius**2 + vehicle.hitch_offset**2 - behind**2)


# --- traction -------------------------------------------------------------------------------------

_PULLING: Final = 0.7  # [m/s]
_SLIPS: Final = np.array(
    [0.0, 0.03, 0.05, 0.07, 0.09, 0.11, 0.13, 0.16, 0.20]
)  # slips that are aimed at

# Slip of the largest tractive efficiency: University of Arizona Cooperative Extension. It names
# surfaces without a cone index and no kind of tyre; each surface is identified by the mobility
# number Bn that ASABE D497 gives for drive tyres (quoted from secondary sources: unconfirmed). Bn,
# not cone index: the same soil is firm for a light vehicle and soft for a heavy one. The curve is
# flat at its top, so that the efficiency at the published slip is compared, not the slip.


class _Surface(NamedTuple):
    """A surface of the source."""

    name: str
    bn: float
    best_slip: float  # middle of the published range


_SURFACES: Final = (
    _Surface("soft soil", 20.0, 0.15),
    _Surface("tilled soil", 40.0, 0.12),
    _Surface("firm soil", 55.0, 0.09),
    _Surface("concrete", 80.0, 0.06),
)


def _surplus(plant: Plant, load: FloatArray, cone_index: float, slip: float) -> float:
    """Return traction less all motion resistance [N] at a slip of the driven wheels."""
    law = plant.wheel_law
    bn, _ = _mobility(plant, load, cone_index)
    return float(load @ law.net_traction_ratio(bn, np.where(DRIVEN, slip, law.towed_slip(bn))))


def slip_for(plant: Plant, load: FloatArray, cone_index: float, pull: float) -> float:
    """Return the slip at which traction less all motion resistance is the pull [N]; NaN if none."""
    slips = np.linspace(0.0, 0.9, 3601)
    surplus = np.array([_surplus(plant, load, cone_index, slip) for slip in slips]) - pull
    crossing = np.flatnonzero((surplus[:-1] <= 0.0) & (surplus[1:] > 0.0))
    if not crossing.size:
        return math.nan
    k = crossing[0]
    return float(slips[k] - surplus[k] * (slips[k + 1] - slips[k]) / (surplus[k + 1] - surplus[k]))


class Pull(NamedTuple):
    """Steady driving under a drawbar pull."""

    slip: float  # of the driven wheels, from rim and ground speed
    law: float  # slip of the traction equation under this pull
    efficiency: float  # power of the driven axle's net pull over power of the drive
    load: FloatArray  # (6,) [N]


def pull_at(bench: Bench, plant: Plant, cone_index: float, slip: float) -> Pull:
    """Drive under the pull that belongs to a slip."""
    load = plant.reset(-20.0, 0.0, 0.0, _PULLING).wheels.load
    pull = max(0.0, _surplus(plant, load, cone_index, slip))
    plant.data.xfrc_applied[plant.body_names.index("tractor"), 0] = -pull
    command = bench.command(_PULLING)
    plant.advance(command, steps(plant, 6.0))
    rows = []
    loads = []
    hydrostat = plant.model.actuator("hydrostat").id
    for _ in range(25):
        truth = drive(plant, command, 0.02, 0.02)[0]
        power = plant.data.actuator_force[hydrostat] * plant.data.actuator_velocity[hydrostat]
        net = truth.wheels.force_long[DRIVEN].sum() * truth.speed
        rows.append((truth.speed, truth.wheel_speed, net, power))
        loads.append(truth.wheels.load)
    speed, rim, net, power = np.mean(rows, axis=0)
    load = np.mean(loads, axis=0)
    law = slip_for(plant, load, cone_index, pull)
    return Pull(float(1.0 - speed / rim), law, float(net / power), load)


def _free_slip(plant: Plant, cone_index: float) -> tuple[FloatArray, float]:
    """Return the loads at rest, (6,) [N], and the slip without a pull."""
    load = plant.reset(0.0, 0.0, 0.0, 0.0).wheels.load
    return load, slip_for(plant, load, cone_index, 0.0)


def slip_against_pull(bench: Bench) -> Iterator[Measured]:
    """Measure the slip of the driven wheels under drawbar pull."""
    for cone_index in dict.fromkeys((bench.cone_index, FIRM_KPA)):
        plant = bench.plant(flat((60.0, 10.0)), cone_index)
        _, free = _free_slip(plant, cone_index)
        pulls = [pull_at(bench, plant, cone_index, free + more) for more in (0.0, 0.05, 0.10)]
        yield Measured(
            max(abs(pull.slip - pull.law) for pull in pulls),
            note="measured (law): "
            + ", ".join(f"{pull.slip:.3f} ({pull.law:.3f})" for pull in pulls),
            words={"kpa": cone_index},
        )


def efficiency(bench: Bench) -> Iterator[Measured]:
    """Measure the efficiency of the driven axle over slip, and its loss at a published slip.

    It is net pull times speed over torque times wheel speed; by the law (1 - MRR / GTR) (1 - s).
    The published slip is that of the surface nearest in Bn under the static load.
    """
    cone_index = bench.cone_index
    plant = bench.plant(flat((60.0, 10.0)), cone_index)
    load, free = _free_slip(plant, cone_index)
    wanted = (free, *_SLIPS[free + 0.005 < _SLIPS])
    pulls = [pull_at(bench, plant, cone_index, slip) for slip in wanted]
    slips, measured = np.array([(pull.slip, pull.efficiency) for pull in pulls]).T
    law = plant.wheel_law

    def driven_bn(load: FloatArray) -> float:
        return float(_mobility(plant, load, cone_index)[0][DRIVEN].mean())

    # at the mean load, because a pull shifts load to the driven wheels
    bn = np.tile([driven_bn(pull.load) for pull in pulls], (len(WHEELS), 1)).T  # (n, 6)
    slip = slips[:, None]
    wheels = law.net_traction_ratio(bn, slip) / law.gross_traction_ratio(bn, slip) * (1.0 - slip)
    expected = wheels[:, DRIVEN].mean(axis=1)
    title = f"Tractive efficiency, {cone_index:.0f} kPa"
    lines = {"plant": measured, "(1 - MRR/GTR)(1 - s)": expected}
    yield Measured(
        np.abs(measured - expected).max(),
        chart=_chart(title, "slip", "tractive efficiency", slips, **lines),
        words={"kpa": cone_index},
    )
    static = driven_bn(load)
    surface = min(_SURFACES, key=lambda each: abs(math.log(each.bn / static)))
    order = np.argsort(slips)
    at_published = float(np.interp(surface.best_slip, slips[order], measured[order]))
    yield Measured(
        100.0 * (float(measured.max()) - at_published),
        note=f"driven wheels at Bn = {static:.0f}, slip of {surface.best_slip:.2f}",
        words={"surface": surface.name},
    )


# --- side force -----------------------------------------------------------------------------------

_SIDE_SLOPES: Final = np.radians([2.0, 4.0, 6.0, 8.0, 10.0])
_CONTOUR: Final = 0.10  # [rad] slope where the scenario is level
_DRIFT_S: Final = 8.0


def side_force(bench: Bench) -> Iterator[Measured]:
    """Measure side force over load at the slip angle of rear and trailer axle on side slopes.

    Slip angles follow from the motion of the axle points, not from the report of the wheels.
    """
    rows = []  # slip angle, side force over load, the same by the law
    for slope in _SIDE_SLOPES.tolist():
        plant = bench.plant(flat((40.0, 20.0)).tilted(slope, _UP_Y), bench.cone_index)
        plant.reset(-10.0, 0.0, 0.0, SPEED)
        plant.advance(bench.command(), steps(plant, 2.0))
        truths = drive(plant, bench.command(), 1.0, 0.05)
        load, side, slip = (
            np.mean(column(truths, f"wheels.{name}"), axis=0)
            for name in ("load", "force_lat", "slip")
        )
        mobility = _mobility(plant, load, bench.cone_index)
        # the slip angle of the law refers to the speed of travel, or of sliding where it is larger
        travel = [max(t.speed, abs(t.wheel_speed - t.speed)) for t in truths]
        rear = np.mean(
            [math.atan2(t.lateral_speed, v) for t, v in zip(truths, travel, strict=True)]
        )
        span = truths[-1].time_s - truths[0].time_s
        first = truths[0].trailer
        last = truths[-1].trailer
        # the field's y rises with the slope
        velocity = np.array([last.x - first.x, (last.y - first.y) / math.cos(slope)]) / span
        yaw = np.mean([t.trailer.yaw for t in truths])
        trailer = math.atan2(
            velocity[1] * math.cos(yaw) - velocity[0] * math.sin(yaw),
            velocity[0] * math.cos(yaw) + velocity[1] * math.sin(yaw),
        )
        for axle, angle in ((DRIVEN, float(rear)), (TRAILER, trailer)):
            _, both = plant.wheel_law.combined_ratios(*mobility, slip, np.full(len(WHEELS), angle))
            total = load[axle].sum()
            rows.append((angle, side[axle].sum() / total, load[axle] @ both[axle] / total))
    angles, measured, expected = np.array(rows)[np.argsort([row[0] for row in rows])].T
    degrees = np.degrees(angles)
    title = f"Side force, {bench.cone_index:.0f} kPa"
    lines = {"plant": measured, "lateral law": expected}
    yield Measured(
        np.abs(measured - expected).max(),
        note=f"slip angles {degrees.min():.2f} to {degrees.max():.2f} deg",
        chart=_chart(title, "slip angle [deg]", "side force / load", degrees, **lines),
        words={"kpa": bench.cone_index},
    )


def contour(bench: Bench) -> Iterator[Measured]:
    """Measure the drift down the slope along a contour, steering straight."""
    slope = bench.slope_rad or _CONTOUR
    plant = bench.plant(flat((60.0, 30.0)), bench.cone_index)
    plant.reset(0.0, 0.0, 0.0, 0.0)
    planar = Planar.of(bench.nominal, plant)
    plant = bench.plant(flat((60.0, 30.0)).tilted(slope, _UP_Y), bench.cone_index)
    plant.reset(-20.0, 0.0, 0.0, SPEED)
    truths = drive(plant, bench.command(), _DRIFT_S, 0.1)
    speed = float(np.mean(column(truths, "speed")))
    time = column(truths, "time_s")
    load = np.mean(column(truths, "wheels.load"), axis=0)  # the slope shifts the loads
    pull = plant.model.opt.gravity[2] * math.sin(slope)
    motion = steady_motion(planar, 0.0, speed, load, bench.cone_index, pull)
    down = -column(truths, "tractor.y") / math.cos(slope)
    predicted = -(motion.lateral_speed * time + 0.5 * speed * motion.yaw_rate * time**2)
    title = f"Along a contour, slope {slope:.2f} rad, {bench.cone_index:.0f} kPa"
    lines = {"plant": down, "balance of forces": predicted}
    yield Measured(
        100.0 * down[-1],
        100.0 * predicted[-1],
        chart=_chart(title, "time [s]", "drift down the slope [m]", time, **lines),
        words={"slope": slope, "way_m": speed * _DRIFT_S},
    )


# --- kinematics -----------------------------------------------------------------------------------


def hitch_kinematics(bench: Bench) -> Iterator[Measured]:
    """Measure the yaw rate of a weaving trailer, lambda = psi_t - psi_i, against rolling.

    psi_i' (L_i + d cos delta_i) = v sin lambda - a psi_t' cos lambda - d delta_i' cos delta_i

    Then the chain of lengths from axle to axle, and the residual with each sign flipped.
    """
    vehicle = bench.nominal
    every_s = 0.02
    plant = bench.plant(flat((60.0, 60.0)))
    plant.reset(-20.0, 0.0, 0.0, SPEED)
    truths = []
    for t in (every_s * k for k in range(750)):
        command = bench.command(SPEED, 0.25 * math.sin(0.5 * t), 0.3 * math.sin(1.3 * t))
        truths.append(plant.advance(command, steps(plant, every_s)))

    # From axle to axle along the lengths
    v, yaw_t, yaw_d, yaw_i, delta_i, rate_t, rate_i = (
        column(truths, name)
        for name in (
            "speed",
            "tractor.yaw",
            "psi_d",
            "trailer.yaw",
            "delta_i",
            "yaw_rate_t",
            "yaw_rate_i",
        )
    )
    chain = sum(
        length * np.column_stack([np.cos(yaw), np.sin(yaw)])
        for length, yaw in (
            (vehicle.hitch_offset, yaw_t),
            (vehicle.drawbar_length, yaw_d),
            (vehicle.trailer_length, yaw_i),
        )
    )
    axles = column(truths, "tractor")[:, :2] - column(truths, "trailer")[:, :2]

    # The yaw rate of rolling, term by term
    lam = yaw_t - yaw_i
    drawbar = vehicle.drawbar_length * np.cos(delta_i)
    turning = -vehicle.hitch_offset * rate_t * np.cos(lam)
    terms = np.array([v * np.sin(lam), turning, -drawbar * np.gradient(delta_i, every_s)])

    def residual(signs: FloatArray) -> float:
        error = rate_i - signs @ terms / (vehicle.trailer_length + drawbar)
        return float(np.sqrt(np.mean(error[50:] ** 2)))

    right = residual(np.ones(3))
    yield Measured(right, note=f"of {np.sqrt(np.mean(rate_i**2)):.3f} rad/s rms")
    yield Measured(1e3 * np.linalg.norm(axles - chain, axis=1).max())
    for signs, term in zip(
        1.0 - 2.0 * np.eye(3),
        ("v sin lambda", "a psi_t' cos lambda", _BY_STEERING),
        strict=True,
    ):
        if term == _BY_STEERING and bench.nominal.is_plain:
            yield Measured(None, words={"term": term}, note=_PLAIN)
        else:
            yield Measured(residual(signs) / right, words={"term": term})


# --- rough ground ---------------------------------------------------------------------------------

_HEIGHT: Final = 0.15  # of the bump over the smallest wheel's radius, which is its length
_RUN_UP_M: Final = 2.0


def bump(bench: Bench) -> Iterator[Measured]:
    """Measure loads and remaining energy after a (1 - cos) bump across the lane.

    The energy is that of vertical motion and of the tyre deflections relative to steady rolling,
    sum m vz^2 / 2 + sum (N - N0)^2 / 2k.
    """
    plant = bench.plant(flat((60.0, 8.0)))
    every_s = plant.timestep_s * steps(plant, 0.01)
    plant.reset(0.0, 0.0, 0.0, 0.0)
    radius = float(plant.tyres.radius.min())
    places = wheel_places(plant)[:, 0]
    length = radius
    ahead = places.max() + _RUN_UP_M
    plant = bench.plant(_lane(ahead, length, _HEIGHT * radius))
    plant.reset(0.0, 0.0, 0.0, SPEED)

    # Drive until the last wheel has left the bump, and a second more
    travel = ahead + length - places.min() + 0.3
    loads = []
    verticals = []
    for _ in range(round((travel / SPEED + 1.0) / every_s)):
        before = plant.data.xipos[:, 2].copy()
        loads.append(drive(plant, bench.command(), every_s, every_s)[0].wheels.load)
        verticals.append((plant.data.xipos[:, 2] - before) / every_s)
    force = np.array(loads)
    vertical = np.array(verticals)

    # Energy beside that of rolling on the level ground before the bump
    mass = plant.model.body_mass
    stiffness = plant.tyres.stiffness
    run_up = round((_RUN_UP_M - 0.2) / SPEED / every_s)
    rest = force[run_up - round(0.5 / every_s) : run_up].mean(axis=0)
    energy = 0.5 * vertical**2 @ mass + 0.5 * (force - rest) ** 2 @ (1.0 / stiffness)
    remaining = float(energy[-round(0.2 / every_s) :].mean() / energy[run_up:].max())

    time = every_s * np.arange(1.0, len(energy) + 1.0)
    lines = (("front left", 0), ("rear left", 2), ("trailer left", 4))
    chart = Chart(
        f"Over a bump of {100.0 * _HEIGHT * radius:.0f} cm",
        "time [s]",
        "wheel load [kN]",
        tuple(Line(name, time, 1e-3 * force[:, wheel]) for name, wheel in lines),
    )
    note = f"{np.mean(force <= 0.0):.1%} of the samples without load"
    yield Measured(force.min(), note=note, chart=chart)
    yield Measured(100.0 * remaining)


def _lane(start: float, length: float, height: float) -> Terrain:
    """Return level ground with a bump from `start` on across the whole width; all in [m]."""
    lane = flat((60.0, 8.0), spacing_m=0.05)
    x = lane.origin[0] + lane.spacing_m * np.arange(lane.heights.shape[1])
    inside = (x > start) & (x < start + length)
    wave = 0.5 * height * (1.0 - np.cos(2.0 * np.pi * (x - start) / length))
    return Terrain(np.where(inside, wave, 0.0) + lane.heights, lane.spacing_m, lane.origin)


# --- conservation ---------------------------------------------------------------------------------

_FALL_S: Final = 0.5
_HIGH_M: Final = 5.0  # above the ground, more than it falls


def free_fall(bench: Bench) -> Iterator[Measured]:
    """Measure a free fall with spinning wheels and a swinging trailer, without damping or drive."""
    plant = bench.plant(flat((20.0, 20.0)))
    plant.reset(0.0, 0.0, 0.0, 1.0)
    _remove_losses(plant)
    data = plant.data
    data.qpos[2] += _HIGH_M
    for joint, rate in (("rj1_yaw", 0.5), ("rj1_roll", 0.3), ("rj1_pitch", 0.2)):
        data.joint(joint).qvel[0] = rate
    data.qvel[3:6] = 0.1, -0.05, 0.2
    mujoco.mj_step1(plant.model, data)
    energy, momentum, spin = _mechanics(plant)
    data.xfrc_applied[:] = 0.0
    for _ in range(steps(plant, _FALL_S)):  # without forces of wheels: none touches the ground
        couple_joints(plant.coupling)
        mujoco.mj_step2(plant.model, data)
        mujoco.mj_step1(plant.model, data)
    energy_after, momentum_after, spin_after = _mechanics(plant)
    mass = plant.model.body_mass.sum()
    fallen = momentum + mass * _FALL_S * plant.model.opt.gravity
    yield Measured(float(np.abs(momentum_after - fallen).max() / (mass * 9.81 * _FALL_S)))
    yield Measured(float(np.linalg.norm(spin_after - spin) / np.linalg.norm(spin)))
    yield Measured(abs(energy_after / energy - 1.0))


def frictionless(bench: Bench) -> Iterator[Measured]:
    """Measure a vehicle that slides ahead and aside on the normal forces of its wheels alone."""
    plant = bench.plant(flat((20.0, 20.0)))
    plant.reset(0.0, 0.0, 0.0, 0.0)
    _remove_losses(plant)
    plant.data.qvel[:2] += 1.0, 0.5
    mujoco.mj_step1(plant.model, plant.data)
    _, momentum, _ = _mechanics(plant)
    kinetic = _kinetic(plant)
    for _ in range(steps(plant, 1.0)):
        _slide(plant)
    _, after, _ = _mechanics(plant)
    scale = float(np.linalg.norm(momentum[:2]))
    yield Measured(float(np.abs(after - momentum)[:2].max()) / scale)
    yield Measured(abs(_kinetic(plant) - kinetic) / kinetic)


def _remove_losses(plant: Plant) -> None:
    """Remove drive, damping and friction from the model."""
    for name in (
        "actuator_gainprm",
        "actuator_biasprm",
        "dof_damping",
        "dof_frictionloss",
        "geom_friction",
    ):
        getattr(plant.model, name)[:] = 0.0


def _slide(plant: Plant) -> None:
    """Advance one physics step with the normal forces of the wheels alone."""
    model = plant.model
    data = plant.data
    ids = np.array([plant.body_names.index(wheel) for wheel in WHEELS])
    motion = wheel_motion(plant)
    touch = tyre.contact(plant.tyres, plant.terrain, motion)
    force = touch.load[:, None] * touch.normal
    data.xfrc_applied[ids, :3] = force
    data.xfrc_applied[ids, 3:] = np.cross(touch.point - motion.centre, force)
    couple_joints(plant.coupling)
    mujoco.mj_step2(model, data)
    mujoco.mj_step1(model, data)


def _mechanics(plant: Plant) -> tuple[float, FloatArray, FloatArray]:
    """Return kinetic energy [J] about the centre of mass, momentum [N s], angular momentum [N m s].

    The energy is that about the centre of mass: the energy of the fall itself has the integrator's
    error dt / t, which is not a property of the model.
    """
    model = plant.model
    data = plant.data
    mujoco.mj_subtreeVel(model, data)
    mass = float(model.body_mass.sum())
    momentum = mass * data.subtree_linvel[1].copy()
    energy = _kinetic(plant) - 0.5 * float(momentum @ momentum) / mass
    return energy, momentum, data.subtree_angmom[1].copy()


def _kinetic(plant: Plant) -> float:
    mujoco.mj_energyVel(plant.model, plant.data)
    return float(plant.data.energy[1])


# --- numerics -------------------------------------------------------------------------------------

_TIMESTEPS_S: Final = (0.0005, 0.001, 0.002, 0.004)
_CONVERGE_S: Final = 10.0


def convergence(bench: Bench) -> Iterator[Measured]:
    """Measure the end point after 10 s on the scenario's ground at four time steps."""
    ends = []
    (x, y) = bench.terrain.centre
    for timestep in _TIMESTEPS_S:
        plant = bench.plant(bench.terrain, bench.soil, timestep_s=timestep)
        plant.reset(x - 0.5 * SPEED * _CONVERGE_S, y, 0.0, SPEED)
        truth = plant.advance(bench.command(SPEED, 0.03), steps(plant, _CONVERGE_S))
        ends.append((truth.tractor.x, truth.tractor.y, truth.trailer.x, truth.trailer.y))
    apart = np.abs(np.array(ends) - ends[0]).max(axis=1)
    text = ", ".join(
        f"{1e3 * away:.1f} mm at {1e3 * step:g} ms"
        for away, step in zip(apart[1:], _TIMESTEPS_S[1:], strict=True)
    )
    yield Measured(1e3 * apart.max(), note=f"from that at 0.5 ms: {text}")
