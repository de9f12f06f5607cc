"""Lifecycle node around `ttempc.Guidance`.

Configured, it has a guidance for the line and the vehicle of its parameters. Active, it turns
positions and joint states into commands; beyond the end of the line, and inactive, it sends none
that moves the vehicle.

Topics: `tractor/position`, `trailer/position` (geometry_msgs/PointStamped, map frame),
`tractor/velocity`, `trailer/velocity` (geometry_msgs/TwistStamped, map frame; optional),
`joint_states` (sensor_msgs/JointState) in, `commands` (sensor_msgs/JointState) out. The service
`~/resume` (std_srvs/Trigger) lets a stopped vehicle drive on.
"""

import numpy as np
import rclpy
from geometry_msgs.msg import PointStamped, TwistStamped
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from ttempc import Guidance, GuidanceSettings, Measurement, Sensor, Vehicle, smooth
from ttempc.errors import TtempcError

ANGLES = {
    "front_steering": Sensor.STEERING_TRACTOR,
    "trailer_steering": Sensor.STEERING_TRAILER,
    "hitch": Sensor.HITCH,
}
POSITIONS = {
    "tractor/position": Sensor.GNSS_TRACTOR,
    "trailer/position": Sensor.GNSS_TRAILER,
}
VELOCITIES = {
    "tractor/velocity": Sensor.VELOCITY_TRACTOR,
    "trailer/velocity": Sensor.VELOCITY_TRAILER,
}
VEHICLE = (
    "wheelbase",
    "hitch_offset",
    "drawbar_length",
    "trailer_length",
    "steering_limit_t",
    "steering_limit_i",
    "speed_gain",
)
"""Parameters that are fields of `ttempc.Vehicle`."""


class GuidanceNode(LifecycleNode):
    """Turns positions and joint states into steering angles and a hydrostat position."""

    def __init__(self) -> None:
        super().__init__("ttempc_guidance")
        self.declare_parameter("waypoints", [0.0, 0.0, 30.0, 0.0])
        self.declare_parameter("max_deviation_m", 0.1)
        self.declare_parameter("speed_mps", 1.0)
        self.declare_parameter("period_s", 0.2)
        self.declare_parameter("controller", "ttempc")
        self.declare_parameter("rear_wheel_radius_m", 0.40)
        for name in VEHICLE:
            self.declare_parameter(name, getattr(Vehicle(), name))
        self.samples: list[Measurement] = []
        self.guidance: Guidance | None = None
        self.timer = None

    def value(self, name: str):
        """Return the value of a parameter."""
        return self.get_parameter(name).value

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the guidance; refuse a line or a vehicle that cannot be driven."""
        del state
        try:
            points = np.array(self.value("waypoints"), dtype=float).reshape(-1, 2)
            vehicle = Vehicle(**{name: self.value(name) for name in VEHICLE})
            self.guidance = Guidance(
                vehicle,
                smooth(points, self.value("max_deviation_m")).path,
                self.value("period_s"),
                self.value("controller"),
                settings=GuidanceSettings(speed_mps=self.value("speed_mps")),
            )
        except (TtempcError, ValueError) as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self.guidance.warm_up()  # compiles, for some seconds on a new machine
        self.commands = self.create_lifecycle_publisher(JointState, "commands", 10)
        self.inputs = [
            self.create_subscription(
                PointStamped,
                topic,
                lambda message, sensor=sensor: self.on_position(message, sensor),
                10,
            )
            for topic, sensor in POSITIONS.items()
        ]
        self.inputs += [
            self.create_subscription(
                TwistStamped,
                topic,
                lambda message, sensor=sensor: self.on_velocity(message, sensor),
                10,
            )
            for topic, sensor in VELOCITIES.items()
        ]
        self.inputs.append(self.create_subscription(JointState, "joint_states", self.on_joints, 50))
        self.service = self.create_service(Trigger, "~/resume", self.on_resume)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to drive: the first tick with both positions starts the reference."""
        self.samples.clear()
        self.timer = self.create_timer(self.value("period_s"), self.tick)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the vehicle: the last command has straight steering and no drive."""
        self.destroy_timer(self.timer)
        self.publish(0.0, 0.0, 0.0)
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget guidance and topics; the next configuration makes others."""
        del state
        for subscription in self.inputs:
            self.destroy_subscription(subscription)
        self.destroy_service(self.service)
        self.destroy_lifecycle_publisher(self.commands)
        self.guidance = None
        return TransitionCallbackReturn.SUCCESS

    def on_position(self, message: PointStamped, sensor: Sensor) -> None:
        """Take in the position of an axle point in the map frame [m]: x east, y north."""
        point = message.point
        self.samples.append(Measurement(seconds(message.header.stamp), sensor, (point.x, point.y)))

    def on_velocity(self, message: TwistStamped, sensor: Sensor) -> None:
        """Take in the velocity of a receiver [m/s] by Doppler: x east, y north; it states no sd."""
        linear = message.twist.linear
        value = (linear.x, linear.y, 0.0)
        self.samples.append(Measurement(seconds(message.header.stamp), sensor, value))

    def on_joints(self, message: JointState) -> None:
        """Take in angles [rad], counter-clockwise, and the speed of the rear wheels [rad/s]."""
        time_s = seconds(message.header.stamp)
        radius_m = self.value("rear_wheel_radius_m")
        for name, angle, rate in zip(message.name, message.position, message.velocity, strict=True):
            if name in ANGLES:
                self.samples.append(Measurement(time_s, ANGLES[name], (angle,)))
            elif name == "rear_wheel":
                self.samples.append(Measurement(time_s, Sensor.ENCODER, (rate * radius_m,)))

    def on_resume(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Let a vehicle drive on that was stopped, as an operator has asked."""
        del request
        self.guidance.resume()
        response.success, response.message = True, "the vehicle may drive on"
        return response

    def tick(self) -> None:
        """Publish the command of one control period; beyond the end of the line, a stop."""
        guidance = self.guidance
        seen = {sample.sensor for sample in self.samples}
        if guidance.tick == 0 and not set(POSITIONS.values()) <= seen:
            return  # the first tick starts the reference: wait for both receivers
        samples, self.samples = self.samples, []
        guidance.update(1e-9 * self.get_clock().now().nanoseconds, samples)
        finished = guidance.finished
        command = guidance.step()
        if guidance.diagnostics.fallback:
            self.get_logger().warning(guidance.diagnostics.fallback)
        self.publish(command.delta_t, command.delta_i, 0.0 if finished else command.hp)

    def publish(self, delta_t: float, delta_i: float, hydrostat: float) -> None:
        """Publish a command: both steering angles [rad], hydrostat position as a fraction."""
        message = JointState()
        message.header.stamp = self.get_clock().now().to_msg()
        message.name = ["front_steering", "trailer_steering", "hydrostat"]
        message.position = [float(delta_t), float(delta_i), float(hydrostat)]
        self.commands.publish(message)


def seconds(stamp) -> float:
    """Return a time stamp in seconds."""
    return stamp.sec + 1e-9 * stamp.nanosec


def main() -> None:
    """Run the node until it is interrupted."""
    rclpy.init()
    node = GuidanceNode()
    try:
        rclpy.spin(node)
    finally:
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    main()
