"""The ROS 2 node: a thin shell around `swardmap.pipeline`.

`messages`, `parameters`, `inputs`, `frame_queue` and `watched_mapper` need no ROS; `topics` and `node` import
rclpy late.
"""
