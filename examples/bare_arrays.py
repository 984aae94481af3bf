"""Depth 3 of the API: the bare functions, from a depth image and a mask to a costmap.

python examples/bare_arrays.py
"""

import numpy as np

from swardmap.config import CostmapConfig
from swardmap.geometry import Intrinsics, mount_pose
from swardmap.grid import GridSpec, OccupancyGrid, classify_cells, count_points
from swardmap.labels import GRASS_OBSTACLE, MapClass
from swardmap.mapping.costmap import build_costmap
from swardmap.perception.cloud import consistent_depth, crop_height, crop_range, label_cloud
from swardmap.types import Frame, Segmentation


def main() -> None:
    # a camera 1 m above a lawn, looking down 30 degrees; a wall stands 2.52 m ahead on the right
    camera = Intrinsics(320, 240, 230.0, 230.0, 159.5, 119.5)
    T_map_camera = mount_pose(1.0, 30.0, parent="map")
    ray_x, ray_y = camera.ray_tables()
    down = np.sin(np.deg2rad(30)) + np.cos(np.deg2rad(30)) * ray_y[:, None] + 0 * ray_x
    depth_m = np.where(down > 0.15, 1 / np.maximum(down, 0.15), np.nan).astype(np.float32)
    wall_m = (2.52 / (np.cos(np.deg2rad(30)) - np.sin(np.deg2rad(30)) * ray_y[:, None]) + 0 * ray_x).astype(
        np.float32
    )
    is_wall = (ray_x > 0.1)[None, :] & ~(depth_m < wall_m)
    depth_m = np.where(is_wall, wall_m, depth_m)
    mask = np.where(is_wall, 0, 1).astype(np.uint8)

    frame = Frame(0, camera, np.zeros((240, 320, 3), np.uint8), depth_m)
    clean_m = consistent_depth(crop_range(frame.depth_m, 0.3, 8.0), 3, 0.03, 0.02)
    cloud = label_cloud(frame, Segmentation(mask, GRASS_OBSTACLE), clean_m)  # Eq. 1

    spec = GridSpec(resolution_m=0.1, width=60, height=60, origin_m=(0.0, -3.0))
    cloud = crop_height(cloud.transformed(spec.T_grid_map @ T_map_camera), -0.5, 2.0)
    counts, _ = count_points(cloud, spec)  # Eq. 2
    grid = OccupancyGrid(spec, classify_cells(counts, min_points=3))
    costmap = build_costmap(grid, CostmapConfig(margin_m=0.2))

    wall = spec.center_of(np.argwhere(grid.is_obstacle)[:, ::-1])
    avoid = np.count_nonzero(costmap.costs >= 253)
    print(f"the wall stands at x = {wall[:, 0].min():.2f} .. {wall[:, 0].max():.2f} m")
    print(f"{grid.count(MapClass.GRASS)} cells of grass, {avoid} to keep out of")


if __name__ == "__main__":
    main()
