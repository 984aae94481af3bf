"""Everything that is slow the first time, done before the first frame comes: kernels and network."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config, GridConfig
from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.mapping.costmap import build_costmap
from swardmap.mapping.last_seen_map import LastSeenMap
from swardmap.monitor.diagnostics import frame_stats
from swardmap.perception.align import align_depth_to_color
from swardmap.pipeline import ObstacleMapper
from swardmap.ros.clouds import cloud_fields, height_row
from swardmap.segmenter import Segmenter
from swardmap.types import Frame

SMALL = Intrinsics(64, 48, 46.0, 46.0, 31.5, 23.5)

POSES = tuple(
    mount_pose(1.0, 45.0, yaw_deg=yaw_deg, xy_m=(yaw_deg, 0.0), parent="warm_up") for yaw_deg in (0, 3)
)
"""Two, that see other parts of the map's tiles: kernels are compiled for each layout of an array."""


def warm_up(config: Config, segmenter: Segmenter) -> None:
    """Map invented frames into a map that is thrown away.

    Otherwise the first frame would wait for seconds: compiled kernels are read from the disk, or compiled if
    there are none, and a network is laid out in memory when it runs first.

    Raises:
        SwardmapError: for settings or a network with which no frame can be mapped.
    """
    mapper = ObstacleMapper(segmenter, config)
    grids = [LastSeenMap(grid, "warm_up") for grid in _grids(config.grid)]
    for i, (T_map_camera, (raw, unit_m)) in enumerate(product(POSES, _depth_images())):
        align_depth_to_color(raw, unit_m, SMALL, SMALL, Pose.identity("color", "depth"))
        rgb = np.full((SMALL.height, SMALL.width, 3), 90, np.uint8)
        frame = Frame(i, SMALL, rgb, raw, unit_m, T_map_camera)
        frame_stats(frame, i, T_map_camera)
        step = mapper.step(frame)
        cloud_fields(frame, step.segmentation, height_row(step), config.cloud, (0, "warm_up"))
        grass = np.full_like(step.observation.classes, MapClass.GRASS)  # whatever the network said of grey
        for each in grids:
            each.integrate(replace(step.observation, classes=grass))
    grid = OccupancyGrid.unknown(GridSpec(config.grid.resolution_m, 8, 8, (0.0, 0.0), "warm_up"))
    grid.classes[4, 4] = MapClass.PERSON
    build_costmap(grid, config.costmap)


def _grids(config: GridConfig) -> Iterator[GridConfig]:
    """As configured, and such that lie within the view or around it."""
    yield replace(config, mode="last_seen", resume=None)
    for half_m in (1.0, 50.0):
        corner, size = (-half_m, -half_m), (2 * half_m, 2 * half_m)
        yield replace(config, mode="last_seen", resume=None, origin_m=corner, size_m=size)


def _depth_images() -> Iterator[tuple[NDArray[Any], float]]:
    """Level depth as cameras give it: millimetres or metres, as it came in a message or as it was aligned."""
    metres = np.full((SMALL.height, SMALL.width), 1.5, np.float32)
    for raw, unit_m in (((1000 * metres).astype(np.uint16), 0.001), (metres, 1.0)):
        yield raw, unit_m
        yield np.frombuffer(raw.tobytes(), raw.dtype).reshape(raw.shape), unit_m  # read only
