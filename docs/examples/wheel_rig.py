"""One-wheel test rig: traction against slip of a driven tyre on soil.

    python docs/examples/wheel_rig.py

The carriage moves at a constant speed and carries the load; the wheel turns at a set speed. Pull
and torque are those of the soil, measured by the carriage and the drive.
"""

import mujoco
import numpy as np

from proving_ground import SoilWheels, Tyre

RIG = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom name="bin" type="plane" size="20 2 1"/>
    <body name="carriage" pos="0 0 0.4">
      <joint name="rail" type="slide" axis="1 0 0"/>
      <joint name="lift" type="slide" axis="0 0 1" damping="2000"/>
      <geom type="box" size="0.2 0.1 0.1" mass="200" contype="0" conaffinity="0"/>
      <body name="wheel">
        <joint name="axle" axis="0 1 0"/>
        <geom type="cylinder" size="0.4 0.12" zaxis="0 1 0" mass="40"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <velocity name="tow" joint="rail" kv="1e7"/>
    <velocity name="drive" joint="axle" kv="1e6"/>
  </actuator>
</mujoco>
"""
TYRE = Tyre(
    size="9.5-16",
    radius_m=0.40,
    width_m=0.24,
    section_height_m=0.185,
    relative_deflection=0.20,
    rated_load_n=2500.0,
    damping_spm=0.6,
)
SPEED_MPS = 1.0


def pull_at(slip: float, cone_index_kpa: float) -> tuple[float, float]:
    """Return the pull of the carriage and the torque of the drive over radius, both over load."""
    model = mujoco.MjModel.from_xml_string(RIG)
    data = mujoco.MjData(model)
    wheels = SoilWheels(model, {"wheel": TYRE}, ground="bin", cone_index_kpa=cone_index_kpa)
    data.ctrl[:] = SPEED_MPS, SPEED_MPS / (1.0 - slip) / TYRE.radius_m
    while data.time < 4.0:
        wheels.apply(model, data)
        mujoco.mj_step(model, data)
    load = wheels.report.load[0]
    tow, drive = data.actuator_force
    return -tow / load, drive / TYRE.radius_m / load


def main() -> None:
    """Print the curve on firm and on soft soil."""
    for cone_index_kpa in (900.0, 250.0):
        print(f"cone index {cone_index_kpa:.0f} kPa")
        for slip in np.arange(0.0, 0.31, 0.05):
            pull, torque = pull_at(float(slip), cone_index_kpa)
            print(f"  slip {slip:.2f}  pull/load {pull:6.3f}  torque/(radius load) {torque:6.3f}")


if __name__ == "__main__":
    main()
