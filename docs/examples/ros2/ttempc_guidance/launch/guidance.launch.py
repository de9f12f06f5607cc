"""Start the node, which drives once it is configured and active."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch_ros.actions import LifecycleNode


def generate_launch_description():
    share = Path(get_package_share_directory("ttempc_guidance"))
    node = LifecycleNode(
        package="ttempc_guidance",
        executable="guidance_node",
        name="ttempc_guidance",
        namespace="",
        parameters=[str(share / "config" / "guidance.yaml")],
        output="screen",
    )
    return LaunchDescription([node])
