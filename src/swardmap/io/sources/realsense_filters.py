"""The SDK's post-processing of depth, in the order its authors recommend (doc/post-processing-filters.md)."""

from typing import Any

from swardmap.config import CameraConfig


def depth_filters(rs: Any, config: CameraConfig) -> list[Any]:
    """The filters that are switched on, each with the SDK's own parameters; they keep state, use them once.

    Decimation, then into disparity where noise is even over the range, spatial, temporal, back to depth,
    threshold, and hole filling last.

    Args:
        rs: the module pyrealsense2.
        config: what is switched on.
    """
    filters = []
    if config.decimation > 1:
        filters.append(rs.decimation_filter(float(config.decimation)))
    smoothing = [rs.spatial_filter()] if config.spatial else []
    smoothing += [rs.temporal_filter()] if config.temporal else []
    if smoothing:
        filters += [rs.disparity_transform(True), *smoothing, rs.disparity_transform(False)]
    if config.threshold_m is not None:
        filters.append(rs.threshold_filter(*config.threshold_m))
    if config.hole_filling:
        filters.append(rs.hole_filling_filter())
    return filters
