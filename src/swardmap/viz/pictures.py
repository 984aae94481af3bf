"""Pictures for people: a frame in four panels, a whole map, a whole costmap. RGB, uint8."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.errors import OutputError
from swardmap.geometry import Pose
from swardmap.grid import OccupancyGrid
from swardmap.io.files import write_bytes
from swardmap.labels import LabelSet, Role
from swardmap.mapping.costmap import Costmap
from swardmap.types import Frame, LabeledCloud, Segmentation
from swardmap.viz.drawing import (
    MUTED,
    Box,
    Color,
    Picture,
    blank,
    blend,
    color_bar,
    fitted,
    frame_box,
    legend,
    paste,
    text_width,
    write,
)
from swardmap.viz.maps import (
    GEOMETRY_COLOR,
    MARGIN_COLOR,
    SWATCHES,
    View,
    bounds_of,
    cost_colors,
    draw_camera,
    draw_cells,
    draw_classes,
    draw_costs,
    draw_points,
    draw_scale,
    tint_costs,
)

EDGE, GAP, TITLE = 24, 20, 34
NO_READING: Color = (200, 200, 196)
MAX_HEIGHT = 1600


def frame_picture(
    frame: Frame,
    segmentation: Segmentation,
    cloud: LabeledCloud | None,
    grid: OccupancyGrid,
    costs: NDArray[np.uint8] | None = None,
    T_map_camera: Pose | None = None,
    width: int = 1280,
    by_geometry: NDArray[np.bool_] | None = None,
) -> Picture:
    """One frame in four panels: photo with its mask, depth, cloud from above, local map.

    Cloud and map show the same window, x to the right and y up.

    Args:
        frame: the input.
        segmentation: its mask, at any size.
        cloud: labelled points in the frame of the map, or None.
        grid: the map of this frame alone, or around it.
        costs: (height, width) uint8 costs of `grid`, to show the margin, or None.
        T_map_camera: where the camera is drawn; None = not at all.
        width: of the picture, at least 640.
        by_geometry: (height, width) bool, cells of `grid` that geometry alone marks, or None.

    Returns:
        (H, width, 3) uint8, RGB.
    """
    column = (max(width, 640) - 2 * EDGE - GAP) // 2
    photo_height = min(round(column * frame.intrinsics.height / frame.intrinsics.width), 2 * column)
    map_height = round(column * 0.75)
    sheet = blank(max(width, 640), EDGE + 2 * TITLE + photo_height + GAP + map_height + EDGE)
    left, right = EDGE, EDGE + column + GAP
    upper, lower = EDGE + TITLE, EDGE + 2 * TITLE + photo_height + GAP
    _photo_panel(sheet, (left, upper, column, photo_height), frame, segmentation)
    _depth_panel(sheet, (right, upper, column, photo_height), frame)

    places = [] if T_map_camera is None else [T_map_camera.position_m[:2]]
    view = View.of(bounds_of(grid, *places), column, map_height)
    _cloud_panel(sheet, (left, lower, column, map_height), cloud, view, frame, T_map_camera)
    cells = draw_classes(grid, view)
    swatches = list(SWATCHES)
    if by_geometry is not None:
        draw_cells(cells, by_geometry, grid.spec, view, GEOMETRY_COLOR)
        swatches.append(("geometry", GEOMETRY_COLOR))
    if costs is not None:
        cells = tint_costs(cells, grid, costs, view)
        swatches.append(("cost", MARGIN_COLOR))
    if T_map_camera is not None:
        draw_camera(cells, view, T_map_camera, frame.intrinsics)
    draw_scale(cells, view)
    _panel(sheet, (right, lower, column, map_height), "Map", cells)
    legend(sheet, swatches, right + column, lower - 12)
    return sheet


def map_picture(grid: OccupancyGrid, costs: NDArray[np.uint8] | None = None, width: int = 1280) -> Picture:
    """A whole map with legend and scale, x to the right and y up.

    Args:
        grid: the map; what is known of it fills the picture, however large it is.
        costs: (height, width) uint8 costs of it, to show the margin, or None.
        width: of the picture.

    Returns:
        (H, width, 3) uint8, RGB.
    """
    view = _whole_view(grid, width)
    cells = draw_classes(grid, view)
    swatches = list(SWATCHES)
    if costs is not None:
        cells = tint_costs(cells, grid, costs, view)
        swatches.append(("cost", MARGIN_COLOR))
    sheet, box = _one_panel_sheet(view)
    draw_scale(cells, view)
    _panel(sheet, box, "Map", cells)
    legend(sheet, swatches, box[0] + box[2], box[1] - 12)
    _cell_size(sheet, box, "Map", grid.spec.resolution_m)
    return sheet


def costmap_picture(costmap: Costmap, width: int = 1280) -> Picture:
    """A whole costmap with legend and scale, x to the right and y up.

    Args:
        costmap: what is known of it fills the picture.
        width: of the picture.

    Returns:
        (H, width, 3) uint8, RGB.
    """
    known = OccupancyGrid(costmap.spec, (costmap.costs != 255).astype(np.uint8))
    view = _whole_view(known, width)
    cells = draw_costs(costmap.costs, costmap.spec, view)
    sheet, box = _one_panel_sheet(view)
    draw_scale(cells, view)
    _panel(sheet, box, "Costmap", cells)
    colors = cost_colors()
    named = {"unknown": 0, "free": 1, "inscribed": 254, "lethal": 255}
    entries = [(name, _color(colors[i])) for name, i in named.items()]
    start = legend(sheet, entries, box[0] + box[2], box[1] - 12)
    color_bar(sheet, colors[2:254], "1", "252", start, box[1] - 12)
    _cell_size(sheet, box, "Costmap", costmap.spec.resolution_m)
    return sheet


def write_picture(picture: Picture, path: str | Path) -> None:
    """Write an RGB picture as .png or .jpg.

    Raises:
        OutputError: for another suffix, or if it cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".png", ".jpg", ".jpeg"):
        raise OutputError(f"{path}: expected a picture's name to end in .png or .jpg")
    _, encoded = cv2.imencode(suffix, np.ascontiguousarray(picture[..., ::-1]))
    write_bytes(path, encoded.tobytes())


def overlay(rgb: Picture, labels: NDArray[np.uint8], label_set: LabelSet, opacity: float = 0.45) -> Picture:
    """A photo tinted by class; void stays as it is, borders between classes are drawn.

    Args:
        rgb: (H, W, 3) uint8.
        labels: (H, W) uint8 ids of `label_set`.
        label_set: what the ids mean.
        opacity: of the tint.
    """
    colors = label_set.color_table[labels]
    says_something = label_set.map_class_table[labels] > 0
    tinted = blend(rgb, colors, np.where(says_something, np.float32(opacity), np.float32(0)))
    border = np.zeros(labels.shape, bool)
    border[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    border[1:] |= labels[1:] != labels[:-1]
    tinted[border] = blend(tinted[border][None], np.full((1, int(border.sum()), 3), 255, np.uint8), 0.6)[0]
    return tinted


def depth_colors(depth_m: NDArray[np.float32]) -> tuple[Picture, float, float]:
    """Depth as colours (near bright, far dark, none grey), and the range they span in metres."""
    valid = np.isfinite(depth_m)
    low, high = np.percentile(depth_m[valid], (1, 99)) if valid.any() else (0.0, 1.0)
    high = max(float(high), float(low) + 0.1)
    level = np.nan_to_num((depth_m - low) / (high - low)).clip(0, 1)
    colors = depth_ramp()[(255 * level + 0.5).astype(np.uint8)]
    colors[~valid] = NO_READING
    return colors, float(low), high


def depth_ramp() -> Picture:
    """(256, 3) colours from near to far."""
    ramp = cv2.applyColorMap(np.arange(255, -1, -1, dtype=np.uint8)[:, None], cv2.COLORMAP_VIRIDIS)
    return np.ascontiguousarray(np.asarray(ramp, np.uint8)[:, 0, ::-1])


def _photo_panel(sheet: Picture, box: Box, frame: Frame, segmentation: Segmentation) -> None:
    height, width = frame.intrinsics.height, frame.intrinsics.width
    labels = segmentation.resized_to(height, width).labels
    _panel(sheet, box, "Photo and mask", overlay(frame.rgb, labels, segmentation.label_set))
    shown = [c for c in segmentation.label_set.classes if c.role is not Role.VOID]
    legend(sheet, [(c.name, c.color) for c in shown[:5]], box[0] + box[2], box[1] - 12)


def _depth_panel(sheet: Picture, box: Box, frame: Frame) -> None:
    colors, low, high = depth_colors(frame.depth_m)
    _panel(sheet, box, "Depth", colors)
    start = legend(sheet, [("no reading", NO_READING)], box[0] + box[2], box[1] - 12)
    color_bar(sheet, depth_ramp(), f"{low:.1f} m", f"{high:.1f} m", start, box[1] - 12)


def _cloud_panel(
    sheet: Picture,
    box: Box,
    cloud: LabeledCloud | None,
    view: View,
    frame: Frame,
    T_map_camera: Pose | None,
) -> None:
    points = np.full((view.height, view.width, 3), 245, np.uint8)
    if cloud is not None:
        draw_points(points, cloud, view)
    if T_map_camera is not None:
        draw_camera(points, view, T_map_camera, frame.intrinsics)
    draw_scale(points, view)
    _panel(sheet, box, "Cloud from above", points)
    count = "none" if cloud is None else f"{len(cloud):,} points".replace(",", " ")
    write(sheet, count, box[0] + box[2], box[1] - 12, 14, MUTED, align="right")


def _panel(sheet: Picture, box: Box, title: str, image: Picture) -> None:
    write(sheet, title, box[0], box[1] - 12, 17, weight=600)
    paste(sheet, image, box)
    frame_box(sheet, fitted((image.shape[1], image.shape[0]), box))


def _whole_view(grid: OccupancyGrid, width: int) -> View:
    """As high as what is known needs at full width, within limits."""
    bounds = bounds_of(grid)
    inner = max(width, 640) - 2 * EDGE
    height = round(inner * (bounds[3] - bounds[2]) / (bounds[1] - bounds[0]))
    return View.of(bounds, inner, min(max(height, 240), MAX_HEIGHT))


def _one_panel_sheet(view: View) -> tuple[Picture, Box]:
    sheet = blank(view.width + 2 * EDGE, view.height + EDGE + TITLE + EDGE)
    return sheet, (EDGE, EDGE + TITLE, view.width, view.height)


def _cell_size(sheet: Picture, box: Box, title: str, resolution_m: float) -> None:
    words = f"cells of {resolution_m:g} m"
    write(sheet, words, box[0] + text_width(title, 17, 600) + 16, box[1] - 12, 14, MUTED)


def _color(rgb: NDArray[np.uint8]) -> Color:
    return int(rgb[0]), int(rgb[1]), int(rgb[2])
