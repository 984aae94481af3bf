"""Parameters that Nav2 and its plugins declare, with their defaults, read from their sources.

ros-navigation/navigation2, branch jazzy, f4108e5 (2026-08-21); SteveMacenski/spatio_temporal_voxel_layer,
branch ros2, 403d9ed (2024-03-06); kiwicampus/semantic_segmentation_layer, branch jazzy, 274c713 (2026-04-02).
ROS refuses a value of another type, so the defaults tell the types.
"""

from typing import Any

COSTMAP: dict[str, Any] = {
    # nav2_costmap_2d/src/costmap_2d_ros.cpp, init()
    "always_send_full_costmap": False, "footprint_padding": 0.01, "footprint": "[]", "global_frame": "map",
    "height": 5, "width": 5, "lethal_cost_threshold": 100, "map_topic": "map", "origin_x": 0.0,
    "origin_y": 0.0, "plugins": [], "filters": [], "publish_frequency": 1.0, "resolution": 0.1,
    "robot_base_frame": "base_link", "robot_radius": 0.1, "rolling_window": False,
    "track_unknown_space": False, "transform_tolerance": 0.3, "initial_transform_timeout": 60.0,
    "trinary_costmap": True, "unknown_cost_value": 255, "update_frequency": 5.0, "use_maximum": False,
}  # fmt: skip

LAYERS: dict[str, dict[str, Any]] = {
    # nav2_costmap_2d/plugins/static_layer.cpp, getParameters()
    "nav2_costmap_2d::StaticLayer": {
        "enabled": True, "subscribe_to_updates": False, "map_subscribe_transient_local": True,
        "transform_tolerance": 0.0, "map_topic": "", "footprint_clearing_enabled": False,
    },
    # nav2_costmap_2d/plugins/inflation_layer.cpp, onInitialize()
    "nav2_costmap_2d::InflationLayer": {
        "enabled": True, "inflation_radius": 0.55, "cost_scaling_factor": 10.0, "inflate_unknown": False,
        "inflate_around_unknown": False,
    },
    # nav2_costmap_2d/plugins/obstacle_layer.cpp, onInitialize()
    "nav2_costmap_2d::ObstacleLayer": {
        "enabled": True, "footprint_clearing_enabled": True, "min_obstacle_height": 0.0,
        "max_obstacle_height": 2.0, "combination_method": 1, "observation_sources": "",
    },
    # spatio_temporal_voxel_layer/src/spatio_temporal_voxel_layer.cpp, onInitialize()
    "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer": {
        "observation_sources": "", "transform_tolerance": 0.2, "enabled": True, "publish_voxel_map": False,
        "voxel_size": 0.05, "combination_method": 1, "mark_threshold": 0, "update_footprint_enabled": True,
        "track_unknown_space": True, "decay_model": 0, "voxel_decay": -1.0, "mapping_mode": False,
        "map_save_duration": 60.0,
    },
    # src/semantic_segmentation_layer.cpp, onInitialize()
    "semantic_segmentation_layer::SemanticSegmentationLayer": {
        "enabled": True, "combination_method": 1, "observation_sources": "", "publish_debug_topics": False,
        "use_approximate_time_sync": True,
    },
}  # fmt: skip

SOURCES: dict[str, dict[str, Any]] = {
    # nav2_costmap_2d/plugins/obstacle_layer.cpp, onInitialize(), of each of observation_sources
    "nav2_costmap_2d::ObstacleLayer": {
        "topic": "", "sensor_frame": "", "observation_persistence": 0.0, "expected_update_rate": 0.0,
        "data_type": "LaserScan", "min_obstacle_height": 0.0, "max_obstacle_height": 0.0,
        "inf_is_valid": False, "marking": True, "clearing": False, "obstacle_max_range": 2.5,
        "obstacle_min_range": 0.0, "raytrace_max_range": 3.0, "raytrace_min_range": 0.0,
    },
    # spatio_temporal_voxel_layer/src/spatio_temporal_voxel_layer.cpp, onInitialize()
    "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer": {
        "topic": "", "sensor_frame": "", "observation_persistence": 0.0, "expected_update_rate": 0.0,
        "data_type": "PointCloud2", "min_obstacle_height": 0.0, "max_obstacle_height": 3.0,
        "inf_is_valid": False, "marking": True, "clearing": False, "obstacle_range": 2.5, "min_z": 0.0,
        "max_z": 10.0, "vertical_fov_angle": 0.7, "vertical_fov_padding": 0.0,
        "horizontal_fov_angle": 1.04, "decay_acceleration": 0.0, "filter": "passthrough",
        "voxel_min_points": 0, "clear_after_reading": False, "enabled": True, "model_type": 0,
    },
    # src/semantic_segmentation_layer.cpp, onInitialize()
    "semantic_segmentation_layer::SemanticSegmentationLayer": {
        "segmentation_topic": "", "confidence_topic": "", "labels_topic": "", "pointcloud_topic": "",
        "observation_persistence": 0.0, "expected_update_rate": 0.0, "class_types": [],
        "max_obstacle_distance": 5.0, "min_obstacle_distance": 0.3, "tile_map_decay_time": 5.0,
        "visualize_tile_map": False, "use_cost_selection": True,
    },
}  # fmt: skip

CLASS_TYPE: dict[str, Any] = {
    # src/semantic_segmentation_layer.cpp, onInitialize(), of each of class_types
    "classes": [], "base_cost": 0, "max_cost": 0, "mark_confidence": 0, "samples_to_max_cost": 0,
    "dominant_priority": False,
}  # fmt: skip

FILTERS: dict[str, dict[str, Any]] = {
    # nav2_costmap_2d/plugins/costmap_filters/{costmap_filter,keepout_filter,speed_filter}.cpp
    "nav2_costmap_2d::KeepoutFilter": {
        "enabled": True, "filter_info_topic": "", "transform_tolerance": 0.1, "override_lethal_cost": False,
        "lethal_override_cost": 252,
    },
    "nav2_costmap_2d::SpeedFilter": {
        "enabled": True, "filter_info_topic": "", "transform_tolerance": 0.1,
        "speed_limit_topic": "speed_limit",
    },
}  # fmt: skip

FILTER_INFO: dict[str, Any] = {
    # nav2_map_server/src/costmap_filter_info/costmap_filter_info_server.cpp
    "filter_info_topic": "costmap_filter_info", "type": 0, "mask_topic": "filter_mask", "base": 0.0,
    "multiplier": 1.0,
}  # fmt: skip

MONITOR: dict[str, Any] = {
    # nav2_collision_monitor/src/collision_monitor_node.cpp, getParameters(), configurePolygons(),
    # configureSources()
    "cmd_vel_in_topic": "", "cmd_vel_out_topic": "", "state_topic": "", "base_frame_id": "",
    "odom_frame_id": "", "transform_tolerance": 0.1, "source_timeout": 2.0, "base_shift_correction": True,
    "stop_pub_timeout": 1.0, "polygons": [], "observation_sources": [],
}  # fmt: skip

POLYGON: dict[str, Any] = {
    # nav2_collision_monitor/src/polygon.cpp, getCommonParameters(); circle.cpp, getParameters()
    "type": "", "action_type": "", "enabled": True, "min_points": 4, "visualize": False,
    "time_before_collision": 2.0, "simulation_time_step": 0.1, "slowdown_ratio": 0.5, "radius": 0.0,
    "sources_names": [], "points": "",
}  # fmt: skip

MONITOR_SOURCE: dict[str, Any] = {
    # nav2_collision_monitor/src/source.cpp, getCommonParameters(); pointcloud.cpp, getParameters()
    "type": "scan", "topic": "scan", "enabled": True, "source_timeout": 2.0, "min_height": 0.05,
    "max_height": 0.5, "min_range": 0.0, "use_global_height": False,
}  # fmt: skip
