"""Single manoeuvres of a machine, each of a few seconds, and the figures that they give.

A manoeuvre knows no law and no band: the pages set its figures beside closed forms and published
figures, also with one constant of the machine wrong.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ..bodies import Bodies
from ..ground.ground import Ground
from ..ground.soil import SoilMap
from ..ground.surface import Surface
from ..ground.terrain import flat
from ..implement.implement import Implement
from ..simulation.plant import Plant
from ..truth import WHEELS, Wheels
from ..vehicle.servos import tyres_of
from ..wheels.ruts import Ruts
from ..wheels.tyre_kernel import WheelSet, wheel_step
from .bench import DRIVEN, RELEASED, TRAILER, Bench, column, drive, steps, wheel_places
from .manoeuvres import at_rest

_FRONT: Final = ~(DRIVEN | TRAILER)
_AXLES: Final = (_FRONT, DRIVEN, TRAILER)
_UP: Final = {"across": 0.5 * math.pi, "ahead": 0.0}  # [rad] where a slope rises, vehicle eastward
_EVERY_S: Final = 0.02
_REST_S: Final = 3.0
_AMPLITUDE: Final = math.radians(2.0)
_REAR: Final = WHEELS.index("rear_left")


@dataclass(frozen=True, slots=True)
class Machine:
    """A vehicle on its bench, with a tool, on soil of a strength."""

    bench: Bench
    implement: Implement
    strength: float = 1.0  # cone index of any soil over that which it should have


def standing(machine: Machine) -> list[float]:
    """Return axle loads [kN] and tyre deflections [mm] at rest, on level ground and across a slope.

    Level: three loads, three deflections, and the roll under 3 kN m [deg]. Across 10 deg: what the
    lower wheel of the rear and of the trailer axle carries more than the upper one [kN].
    """
    plant = machine.bench.plant(flat((30.0, 20.0)))
    load = 1e-3 * at_rest(plant, _REST_S)
    deflection = 1e3 * (plant.tyres.radius - wheel_places(plant)[:, 2])
    plant.data.xfrc_applied[plant.body_names.index("tractor"), 3] = 3e3
    roll = math.degrees(plant.advance(RELEASED, steps(plant, 3.0)).tractor.roll)
    slope = machine.bench.plant(flat((30.0, 20.0)).tilted(math.radians(10.0), _UP["across"]))
    across = 1e-3 * at_rest(slope, _REST_S)
    return [
        *(float(load[axle].sum()) for axle in _AXLES),
        *(float(deflection[axle].mean()) for axle in _AXLES),
        roll,
        *(float(across[axle] @ (-1.0, 1.0)) for axle in _AXLES[1:]),
    ]


def climbing(machine: Machine) -> list[float]:
    """Return the front axle's load at 1 m/s up and down 15 deg [kN]."""
    bench = machine.bench
    figures = []
    for yaw in (0.0, math.pi):
        plant = bench.plant(flat((60.0, 20.0)).tilted(math.radians(15.0), _UP["ahead"]))
        plant.reset(0.0, 0.0, yaw, 1.0)
        plant.advance(bench.command(1.0), steps(plant, 4.0))
        loads = column(drive(plant, bench.command(1.0), 1.0, _EVERY_S), "wheels.load")
        figures.append(1e-3 * float(loads[:, _FRONT].sum(axis=1).mean()))
    return figures


def circle(machine: Machine) -> list[float]:
    """Return figures of a circle at 1 m/s with the steering angle of 15 m.

    Yaw rate over speed [1/km], difference of the rear rim speeds over yaw rate [m], how far the
    trailer cuts in [m].
    """
    bench = machine.bench
    names = ("speed", "yaw_rate_t", "yaw_rate_i")
    plant = bench.plant(flat((80.0, 80.0)))
    command = bench.command(1.0, math.atan(2.4 / 15.0))
    plant.reset(0.0, -15.0, 0.0, 1.0)
    plant.advance(command, steps(plant, 25.0))
    truths = drive(plant, command, 2.0, _EVERY_S)
    v, yaw_rate, trailer_rate = (float(column(truths, name).mean()) for name in names)
    spin = plant.data.qvel[[plant.model.joint(wheel).dofadr[0] for wheel in WHEELS]]
    rims = float((spin * plant.tyres.radius)[DRIVEN] @ (-1.0, 1.0))
    way = np.linalg.norm(np.diff(column(truths, "trailer")[:, :2], axis=0), axis=1).sum()
    cut = v / yaw_rate - way / (truths[-1].time_s - truths[0].time_s) / trailer_rate
    return [1e3 * yaw_rate / v, rims / yaw_rate, float(cut)]


def weave(machine: Machine) -> list[float]:
    """Return responses at 1 m/s to steering of 4 deg at 0.1, 0.2 and 0.3 Hz.

    Gain and phase [deg] of the trailer's yaw rate to the tractor's, and phase of the steering angle
    to its command, at each frequency.
    """
    bench = machine.bench
    figures = []
    for frequency in (0.1, 0.2, 0.3):
        plant = bench.plant(flat((120.0, 40.0)))
        rate = 2.0 * math.pi * frequency
        period = round(1.0 / frequency / _EVERY_S)
        rows = []
        plant.reset(-40.0, 0.0, 0.0, 1.0)
        for k in range(2 * period):
            angle = math.radians(4.0) * math.sin(rate * k * _EVERY_S)
            truth = plant.advance(bench.command(1.0, delta_t=angle), steps(plant, _EVERY_S))
            rows.append((truth.yaw_rate_t, truth.yaw_rate_i, truth.delta_t, angle))
        wave = np.exp(-1j * rate * _EVERY_S * np.arange(period))
        tractor, trailer, turned, sent = wave @ np.array(rows[period:])
        held = np.exp(-0.5j * rate * _EVERY_S)  # a command is held from a sample to the next
        ratio = trailer / tractor
        lag = turned / sent * held
        figures += [abs(ratio), *np.degrees([np.angle(ratio), np.angle(lag)]).tolist()]
    return figures


def steering_step(machine: Machine) -> list[float]:
    """Return the time to 63.2 % of 5 deg to the left and to the right [s]."""
    figures = []
    for end in np.radians([5.0, -5.0]).tolist():
        bench = machine.bench
        plant = bench.plant()
        plant.reset(0.0, 0.0, 0.0, 1.0)
        truths = drive(plant, bench.command(1.0, delta_t=end), 1.5, 0.01)
        share = column(truths, "delta_t") / end
        figures.append(float(np.interp(0.632, share, column(truths, "time_s"))))
    return figures


def pull(machine: Machine) -> list[float]:
    """Return net pull over load of the driven axle at three slips, its efficiency [%] at the last.

    On 900 and on 300 kPa, under a pull at the hitch that grows until the wheels spin.
    """
    bench = machine.bench
    figures = []
    for cone_index, slips in ((900.0, (0.05, 0.15, 0.30)), (300.0, (0.15, 0.40, 0.70))):
        plant = bench.plant(flat((120.0, 10.0)), cone_index * machine.strength)
        body = plant.body_names.index("tractor")
        hydrostat = plant.model.actuator("hydrostat").id
        plant.reset(-50.0, 0.0, 0.0, 1.0)
        plant.advance(bench.command(1.0), steps(plant, 1.0))
        rows = []
        while not rows or (len(rows) < 2000 and rows[-1][0] < slips[-1] + 0.05):
            force = 22.0 * len(rows)  # [N] 1.1 kN a second
            below = plant.data.xipos[body, 2] - bench.vehicle.hitch.height_m
            plant.data.xfrc_applied[body, [0, 4]] = -force, force * below
            truth = plant.advance(bench.command(1.0), steps(plant, _EVERY_S))
            power = plant.data.actuator_force[hydrostat] * plant.data.actuator_velocity[hydrostat]
            net = truth.wheels.force_long[DRIVEN].sum()
            load = truth.wheels.load[DRIVEN].sum()
            slip = 1.0 - truth.speed / truth.wheel_speed
            rows.append((slip, net / load, 100.0 * net * truth.speed / power))
        slip, ratio, efficiency = np.array(rows[50:]).T
        figures += np.interp(slips, slip, ratio).tolist()
        figures.append(float(np.interp(slips[-1], slip, efficiency)))
    return figures


def rolling(machine: Machine) -> list[float]:
    """Return motion resistance over load: front axle, trailer on 2,000 kPa, trailer on 300 [%]."""
    bench = machine.bench
    figures = []
    for cone_index in (2000.0, 300.0):
        plant = bench.plant(flat((40.0, 10.0)), cone_index * machine.strength)
        plant.reset(-10.0, 0.0, 0.0, 1.0)
        plant.advance(bench.command(1.0), steps(plant, 2.0))
        wheels = plant.advance(bench.command(1.0), steps(plant, 1.0)).wheels
        shares = [-wheels.force_long[axle].sum() / wheels.load[axle].sum() for axle in _AXLES]
        figures += [100.0 * float(shares[k]) for k in ((0, 2) if cone_index > 1e3 else (2,))]
    return figures


def tyre_test(machine: Machine) -> list[float]:
    """Return side force over load of front, rear and trailer tyre alone at their rated deflection.

    At 1 deg on 2,000, 900 and 300 kPa and at 20 deg on 2,000 and 300; then the way in which 63.2 %
    of it build up at 0.1 deg on 900 kPa [m].
    """
    figures: list[float] = []
    tests = ((2000.0, 1.0), (900.0, 1.0), (300.0, 1.0), (2000.0, 20.0), (300.0, 20.0))
    for cone_index, degrees in tests:
        ratios = _side_forces(machine, cone_index, degrees, speed=1.0, way_m=4.0)
        figures += ratios[-1, ::2].tolist()
    built_up = _side_forces(machine, 900.0, 0.1, speed=0.2, way_m=3.0)[:, ::2]
    ways = 0.2 * 0.002 * np.arange(1.0, len(built_up) + 1.0)
    return figures + [float(np.interp(0.632, y / y[-1], ways)) for y in built_up.T]


def _side_forces(
    machine: Machine, cone_index: float, degrees: float, speed: float, way_m: float
) -> FloatArray:
    """Return side force over load of the tyres, that roll at a slip angle, at each step, (n, 6)."""
    bench = machine.bench
    dt = 0.002
    n = len(WHEELS)
    tyres = tyres_of(bench.vehicle)
    ground = flat((20.0, 20.0))
    angle = math.radians(degrees)
    law = bench.wheel_law.of(tyres.radial)
    ahead = speed * math.cos(angle)
    aside = speed * math.sin(angle)
    bodies = Bodies(
        positions=np.zeros((n + 1, 3)),
        axes=np.tile(np.eye(3).ravel(), (n + 1, 1)),
        mass_centres=np.zeros((n + 1, 3)),
        velocities=np.zeros((n + 1, 6)),
        subtree_centres=np.zeros((n + 1, 3)),
        wrenches=np.zeros((n + 1, 6)),
    )
    strength = np.full(ground.heights.shape, cone_index * machine.strength)
    wheels = WheelSet(
        law=law.table(n),
        tyres=tyres.table(law),
        surface=Surface.of(Ground(ground, strength)),
        ruts=Ruts.none(),
        bodies=bodies,
        numbers=np.arange(1, n + 1),
        treads=np.zeros((n, 3)),
        output=np.zeros((n, len(Wheels._fields))),
        timestep=dt,
    )
    report = Wheels(*wheels.output.T)
    bodies.positions[1:, 2] = tyres.radius - tyres.relative_deflection * tyres.section_height
    bodies.velocities[1:, 1] = ahead / tyres.radius  # rolls without slip
    history = []
    for _ in range(round(way_m / speed / dt)):
        bodies.positions[1:, :2] += ahead * dt, aside * dt
        turning = np.cross(bodies.velocities[1:, :3], bodies.positions[1:])
        bodies.velocities[1:, 3:] = [ahead, aside, 0.0] - turning
        wheel_step(wheels)
        history.append(-report.force_lat / report.load)
    return np.array(history)


def shaken(machine: Machine) -> list[float]:
    """Return stiffness [kN/m] and damping [kN s/m] of each axle's tyres, shaken at 2 Hz."""
    plant = machine.bench.plant(flat((30.0, 20.0)))
    every_s = 0.01
    rate = 4.0 * math.pi
    plant.reset(0.0, 0.0, 0.0, 0.0)
    bodies = [plant.body_names.index(name) for name in ("tractor", "trailer")]
    rows = []
    for k in range(400):
        plant.data.xfrc_applied[bodies, 2] = np.array([4e3, 3e3]) * math.sin(rate * k * every_s)
        load = plant.advance(RELEASED, steps(plant, every_s)).wheels.load
        rows.append([*(1e-3 * load), *wheel_places(plant)[:, 2]])
    wave = np.exp(-1j * rate * every_s * np.arange(200)) @ np.array(rows[200:])
    wave[:6] *= np.exp(1j * rate * plant.timestep_s)  # a load is that of the step before
    stiffness = [-wave[:6][axle].sum() / wave[6:][axle].mean() for axle in _AXLES]
    return [part for each in stiffness for part in (each.real, each.imag / rate)]


def tilling(machine: Machine) -> list[float]:
    """Return the tool's draft at 5 and 10 km/h [kN], its side force by slip angle [N/deg].

    The latter on a slope of 0.1 rad, in a circle of 10 m, in a weave at 0.25 Hz.
    """
    bench = machine.bench
    figures = []
    for speed in (5.0 / 3.6, 10.0 / 3.6):
        plant = _tilling(machine, 0.0)
        plant.reset(-50.0, 0.0, 0.0, speed)
        plant.advance(bench.command(speed), steps(plant, 6.0))
        truths = drive(plant, bench.command(speed), 1.0, _EVERY_S)
        figures.append(1e-3 * float(column(truths, "tool.draft").sum(axis=1).mean()))
    weave = 0.08 * np.sin(0.5 * math.pi * _EVERY_S * np.arange(600))
    circle = np.full(850, math.atan(0.24))
    for slope, warm_s, angles in ((0.1, 4.0, 0.0 * weave), (0.0, 15.0, circle), (0.0, 4.0, weave)):
        plant = _tilling(machine, slope)
        rows = []
        plant.reset(-30.0, 0.0, 0.0, 1.2)
        for angle in angles.tolist():
            truth = plant.advance(bench.command(1.2, delta_t=angle), steps(plant, _EVERY_S))
            tool = truth.tool
            assert tool is not None
            rows.append((tool.x, tool.y / math.cos(slope), truth.trailer.yaw, tool.side.sum()))
        x, y, yaw, side = np.array(rows)[round(warm_s / _EVERY_S) :].T
        slip = np.degrees(np.arctan2(np.gradient(y), np.gradient(x)) - np.unwrap(yaw))
        slip = (slip + 180.0) % 360.0 - 180.0
        figures.append(float(-(slip @ side) / (slip @ slip)))
    return figures


def _tilling(machine: Machine, slope: float) -> Plant:
    """Return the machine with its tool on a plane that rises to its left by a slope [rad]."""
    bench = machine.bench
    ground = flat((120.0, 60.0)).tilted(slope, _UP["across"])
    soil = SoilMap(900.0 * machine.strength)
    law = bench.wheel_law
    return Plant(bench.vehicle, ground, soil, wheel_law=law, implement=machine.implement)


def side_ratio(bench: Bench, slip_angle: float, rim_speed: float, bn: float) -> float:
    """Return side force over load of the machine's rear wheel in steady rolling.

    Args:
        bench: of the machine.
        slip_angle: between the wheel's plane and its travel [rad].
        rim_speed: of the wheel, over its speed of travel.
        bn: mobility number of the wheel, at its rated load.
    """
    law = bench.wheel_law.of(np.array([True]))
    bn_area, m_area = tyres_of(bench.vehicle).mobility_areas(law)[_REAR]
    along = math.cos(slip_angle)
    slip = (rim_speed - along) / max(rim_speed, along)

    # the slip angle of the law refers to the speed along the wheel, or to that of sliding where
    # it is larger
    angle = math.atan(math.sin(slip_angle) / max(along, abs(rim_speed - along)))
    numbers = np.array([bn])
    m = np.array([bn * m_area / bn_area])
    return float(law.combined_ratios(numbers, m, slip, np.array([angle]))[1][0])


def yaw_response(bench: Bench, speed: float, frequency_hz: float, periods: int = 3) -> FloatArray:
    """Return yaw rates of tractor and trailer over the steering angle, complex (2,) [1/s]."""
    plant = bench.plant(bench.terrain)
    plant.reset(-140.0, 0.0, 0.0, speed)
    rate = 2.0 * math.pi * frequency_hz
    rows = []
    for k in range(round((periods + 1) / frequency_hz / _EVERY_S)):
        command = bench.command(speed, delta_t=_AMPLITUDE * math.sin(rate * k * _EVERY_S))
        truth = plant.advance(command, steps(plant, _EVERY_S))
        rows.append((truth.yaw_rate_t, truth.yaw_rate_i, truth.delta_t))
    steady = np.array(rows[round(1.0 / frequency_hz / _EVERY_S) :])  # after the transient
    tractor, trailer, angle = np.exp(-1j * rate * _EVERY_S * np.arange(len(steady))) @ steady
    return np.array([tractor, trailer]) / angle


def natural_frequencies(bench: Bench) -> list[float]:
    """Return the frequencies of the tractor's roll, bounce and pitch after a kick at 1 m/s [Hz].

    Roll is that of the largest motion, as a motion picture shows it; bounce and pitch are those of
    the largest acceleration.
    """
    figures = []
    for dof, name in ((3, "roll"), (2, "z"), (4, "pitch")):  # of the tractor's free joint
        plant = bench.plant(flat((30.0, 20.0)))
        plant.reset(0.0, 0.0, 0.0, 1.0)
        plant.data.qvel[dof] += 0.1
        mujoco.mj_step1(plant.model, plant.data)
        moved = column(drive(plant, bench.command(1.0), 4.0, 0.01), f"tractor.{name}")
        vibration = moved - moved.mean()
        if name != "roll":
            vibration = np.gradient(np.gradient(moved))
        spectrum = np.abs(np.fft.rfft(vibration[2:], 2**14))
        figures.append(float(spectrum.argmax()) / (2**14 * 0.01))
    return figures
