"""The ROS 2 node: a thin shell around `swardmap.pipeline`.

`messages`, `parameters`, `inputs`, `queue` and `engine` need no ROS; `topics` and `node` import rclpy late.
"""
