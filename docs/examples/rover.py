"""Four-wheel rover with skid steering: it climbs a slope of loose soil, then turns on the spot.

    python docs/examples/rover.py

The rover is an ordinary MuJoCo model. `install` brings the soil into every `mj_step`, as it does
into a loop of your own or into MuJoCo's viewer.
"""

import math

import mujoco
import numpy as np

from proving_ground import SoilWheels, Tyre

WHEEL = """
    <body name="{name}" pos="{x} {y} 0">
      <joint name="{name}" axis="0 1 0" armature="0.02"/>
      <geom name="{name}_tyre" type="cylinder" size="0.15 0.05" zaxis="0 1 0" mass="2"/>
    </body>"""
ROVER = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <light pos="0 0 4"/>
    <geom name="slope" type="plane" size="20 20 1" euler="0 {uphill_deg} 0"/>
    <body name="rover" pos="0 0 0.15">
      <freejoint/>
      <geom type="box" size="0.35 0.2 0.08" pos="0 0 0.05" mass="50"/>
      {wheels}
    </body>
  </worldbody>
  <actuator>{motors}</actuator>
</mujoco>
"""
PLACES = {
    "front_left": (0.3, 0.28),
    "front_right": (0.3, -0.28),
    "rear_left": (-0.3, 0.28),
    "rear_right": (-0.3, -0.28),
}
TYRE = Tyre(
    size="about 12x4",
    radius_m=0.15,
    width_m=0.10,
    section_height_m=0.05,
    relative_deflection=0.15,
    rated_load_n=200.0,
    damping_spm=3.0,
)


def rover(
    slope_rad: float = 0.0, cone_index_kpa: float = 300.0
) -> tuple[mujoco.MjModel, SoilWheels]:
    """Return the rover on a slope that rises along x, and its wheels."""
    wheels = [WHEEL.format(name=name, x=x, y=y) for name, (x, y) in PLACES.items()]
    motors = [f'<velocity joint="{name}" kv="100" forcerange="-40 40"/>' for name in PLACES]
    text = ROVER.format(
        uphill_deg=-math.degrees(slope_rad), wheels="".join(wheels), motors="".join(motors)
    )
    model = mujoco.MjModel.from_xml_string(text)
    tyres = {f"{name}_tyre": TYRE for name in PLACES}  # by geom
    return model, SoilWheels(model, tyres, ground="slope", cone_index_kpa=cone_index_kpa)


def drive(slope_rad: float, left_radps: float, right_radps: float) -> tuple[float, float, float]:
    """Return way along x [m], turn [rad] and mean slip after 6 s at these wheel speeds."""
    model, wheels = rover(slope_rad)
    data = mujoco.MjData(model)
    data.ctrl[:] = left_radps, right_radps, left_radps, right_radps
    with wheels.install():
        mujoco.mj_step(model, data, nstep=3000)
    forward = data.body("rover").xmat.reshape(3, 3)[:, 0]
    return data.qpos[0], math.atan2(forward[1], forward[0]), float(np.mean(wheels.report.slip))


def main() -> None:
    """Print what slope and steering do."""
    for slope_deg in (0.0, 10.0, 20.0):
        way, _, slip = drive(math.radians(slope_deg), 4.0, 4.0)
        print(f"slope {slope_deg:2.0f} deg: {way:.2f} m in 6 s, slip {slip:.3f}")
    _, turn, _ = drive(0.0, -1.0, 1.0)
    print(f"turn on the spot: {math.degrees(turn):.0f} deg in 6 s")


if __name__ == "__main__":
    main()
