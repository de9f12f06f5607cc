"""The control library alone, in a loop of one's own: no MuJoCo, time stamps of the Unix epoch.

    python docs/examples/guidance_loop.py

The plant is the library's own kinematic model with sensor noise; replace it by the drivers of
your machine. Prints the mean distance of both axle points from their reference.
"""

import numpy as np

from ttempc import Guidance, Measurement, Sensor, SensorNoise, Vehicle, figure_eight
from ttempc.models.kinematics import articulated, hitch_angle, trailer_point

EPOCH_S = 1_763_775_600.0  # any clock will do
PERIOD_S, STEP_S = 0.2, 0.01
NOISE = SensorNoise()


def sample(state, vehicle, generator, time_s):
    """Return a sample of every sensor; a real machine delivers each at its own rate."""
    values = {
        Sensor.GNSS_TRACTOR: state[:2],
        Sensor.GNSS_TRAILER: trailer_point(state, vehicle),
        Sensor.STEERING_TRACTOR: state[4:5],
        Sensor.STEERING_TRAILER: state[5:6],
        Sensor.HITCH: [hitch_angle(state)],
        Sensor.ENCODER: state[6:7],
    }
    return [
        Measurement(time_s, sensor, tuple(generator.normal(value, NOISE.of(sensor)).tolist()))
        for sensor, value in values.items()
    ]


def main():
    """Drive one lap and print the errors."""
    vehicle, generator = Vehicle(), np.random.default_rng(1)
    guidance = Guidance(vehicle, figure_eight(laps=1), PERIOD_S)
    guidance.warm_up()
    state, time_s, errors = guidance.reference.at(0.0).state, EPOCH_S, []
    while not guidance.finished:
        guidance.update(time_s, sample(state, vehicle, generator, time_s))
        command = guidance.step()
        if guidance.diagnostics.fallback:
            print(f"{time_s - EPOCH_S:6.1f} s  {guidance.diagnostics.fallback}")
        for _ in range(round(PERIOD_S / STEP_S)):
            state = state + STEP_S * articulated(state, command.as_array(), vehicle)
        time_s += PERIOD_S
        reference = guidance.reference.at(time_s - EPOCH_S)
        tractor = np.hypot(*(state - reference.state)[:2])
        errors.append((tractor, np.hypot(*(trailer_point(state, vehicle) - reference.trailer_xy))))
    tractor, trailer = 100.0 * np.mean(errors, axis=0)
    print(f"{guidance.tick} ticks, tractor {tractor:.1f} cm, trailer {trailer:.1f} cm")


if __name__ == "__main__":
    main()
