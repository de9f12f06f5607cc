"""Guidance of a tractor with a trailer as a lifecycle node of ROS 2."""
