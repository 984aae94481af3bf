from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.errors import OutputError
from swardmap.geometry import Intrinsics, Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import GRASS_OBSTACLE_PERSON, OTHER, PERSON, VOID_ID, MapClass
from swardmap.mapping.costmap import Costmap
from swardmap.types import Frame, LabeledCloud, Segmentation
from swardmap.viz import drawing
from swardmap.viz.maps import (
    View,
    bounds_of,
    draw_camera,
    draw_classes,
    draw_costs,
    draw_points,
    tint_costs,
)
from swardmap.viz.pictures import (
    NO_READING,
    costmap_picture,
    depth_colors,
    frame_picture,
    map_picture,
    overlay,
    write_picture,
)

SPEC = GridSpec(0.1, 40, 30, origin_m=(-1.0, 2.0))
CAMERA = Pose("map", "camera", np.array([[0, 0, 1.0, 0], [-1, 0, 0, 2.5], [0, -1, 0, 1], [0, 0, 0, 1]]))


def grid_with_obstacle(ix: int = 30, iy: int = 5) -> OccupancyGrid:
    classes = np.full(SPEC.shape, MapClass.GRASS, np.uint8)
    classes[iy, ix] = MapClass.OBSTACLE
    return OccupancyGrid(SPEC, classes)


def frame(width: int = 64, height: int = 48, depth_m: float = 2.0) -> Frame:
    rng = np.random.default_rng(0)
    return Frame(
        0,
        Intrinsics(width, height, 60.0, 60.0, width / 2, height / 2),
        rng.integers(0, 256, (height, width, 3), np.uint8),
        np.full((height, width), depth_m, np.float32),
    )


def mask(value: int = 1) -> Segmentation:
    return Segmentation(np.full((12, 16), value, np.uint8), GRASS_OBSTACLE_PERSON)


def cloud(*points: tuple[float, float, int]) -> LabeledCloud:
    xyz = np.array([(x, y, 0) for x, y, _ in points], np.float32).reshape(-1, 3)
    return LabeledCloud(xyz, np.array([p[2] for p in points], np.uint8), "map", GRASS_OBSTACLE_PERSON)


def where(picture: NDArray[np.uint8], color: tuple[int, int, int]) -> tuple[float, float]:
    """Mean column and row of a colour."""
    rows, columns = np.nonzero((picture == color).all(axis=2))
    assert len(rows)
    return float(columns.mean()), float(rows.mean())


def test_a_cell_is_drawn_where_it_is() -> None:
    grid = grid_with_obstacle(ix=30, iy=5)
    view = View.of(SPEC.extent_m, 400, 300)
    picture = draw_classes(grid, view)
    rows, columns = np.nonzero((picture == OTHER.color).all(axis=2))
    assert (columns.min(), columns.max()) == (300, 309)
    assert (rows.min(), rows.max()) == (240, 249)  # y up: row 5 of 30 is near the lower edge
    assert view.pixel_of(SPEC.center_of((30, 5))).tolist() == [305, 245]


def test_the_view_is_upright_in_whole_pictures() -> None:
    low = where(map_picture(grid_with_obstacle(iy=2))[60:], OTHER.color)
    high = where(map_picture(grid_with_obstacle(iy=27))[60:], OTHER.color)
    left = where(map_picture(grid_with_obstacle(ix=2))[60:], OTHER.color)
    assert high[1] < low[1]
    assert left[0] < low[0]


def test_points_and_cells_fall_on_the_same_pixels() -> None:
    view = View.of(SPEC.extent_m, 400, 300)
    picture = np.zeros((300, 400, 3), np.uint8)
    x, y = SPEC.center_of((30, 5))
    draw_points(picture, cloud((x, y, 0), (x, y, 1), (99.0, 99.0, 2)), view)
    column, row = view.pixel_of((x, y))
    assert tuple(picture[row, column]) == OTHER.color  # an obstacle lies on top of grass
    assert (picture.any(axis=2)).sum() == 4
    assert not (picture == PERSON.color).all(axis=2).any()


@pytest.mark.parametrize("shape", [(5000, 7000), (3, 9000), (9000, 3)])
def test_one_obstacle_shows_in_a_huge_map(shape: tuple[int, int]) -> None:
    classes = np.full(shape, MapClass.GRASS, np.uint8)
    classes[shape[0] // 2, shape[1] // 2] = MapClass.PERSON
    grid = OccupancyGrid(GridSpec(0.05, shape[1], shape[0]), classes)
    picture = map_picture(grid)
    assert picture.shape[1] == 1280
    assert picture.shape[0] <= 1800
    column, row = where(picture[60:], PERSON.color)
    assert column == pytest.approx(640, abs=4)
    costs = np.zeros(shape, np.uint8)
    costs[shape[0] // 2, shape[1] // 2] = 254
    assert costmap_picture(Costmap(grid.spec, costs)).shape[1] == 1280
    view = View.of(grid.spec.extent_m, 200, 150)
    assert (draw_costs(costs, grid.spec, view) == (92, 30, 56)).all(axis=2).any()
    assert 0 <= row < picture.shape[0]


def test_lethal_is_never_hidden_by_unknown_when_cells_are_smaller_than_pixels() -> None:
    costs = np.full((100, 100), 255, np.uint8)
    costs[50, 50] = 254
    picture = draw_costs(costs, GridSpec(0.01, 100, 100), View.of((0, 1, 0, 1), 10, 10))
    assert (picture == (92, 30, 56)).all(axis=2).sum() == 1


def test_empty_maps_are_drawn() -> None:
    for spec in (SPEC, GridSpec(0.05, 1, 1), GridSpec(10, 1, 3000)):
        assert map_picture(OccupancyGrid.unknown(spec)).dtype == np.uint8
        assert costmap_picture(Costmap(spec, np.full(spec.shape, 255, np.uint8))).dtype == np.uint8
    unknown = OccupancyGrid.unknown(SPEC)
    assert frame_picture(frame(depth_m=0), mask(VOID_ID), None, unknown).shape[1] == 1280
    assert frame_picture(frame(), mask(), cloud(), unknown, T_map_camera=CAMERA).shape[1] == 1280


@pytest.mark.parametrize("size", [(64, 48), (1280, 720), (1, 1), (30, 400)])
@pytest.mark.parametrize("width", [640, 1280])
def test_a_frame_has_four_panels_at_any_size(size: tuple[int, int], width: int) -> None:
    grid = grid_with_obstacle()
    costs = np.zeros(SPEC.shape, np.uint8)
    picture = frame_picture(frame(*size), mask(), cloud((0, 3, 2)), grid, costs, CAMERA, width)
    assert picture.shape[1:] == (width, 3)
    lower = picture[picture.shape[0] // 2 :]
    column = (width - 48 - 20) // 2
    person_in_cloud = where(lower[:, 24 : 24 + column], PERSON.color)
    assert 0 < person_in_cloud[0] < column
    obstacle_in_map = where(lower[40:, -24 - column : -24], OTHER.color)
    assert 0 < obstacle_in_map[0] < column


def test_the_same_input_gives_the_same_picture() -> None:
    one, two = (frame_picture(frame(), mask(), cloud((0, 3, 2)), grid_with_obstacle()) for _ in range(2))
    assert np.array_equal(one, two)


def test_the_margin_tints_what_is_no_obstacle() -> None:
    grid = grid_with_obstacle()
    view = View.of(SPEC.extent_m, 400, 300)
    plain = draw_classes(grid, view)
    costs = np.full(SPEC.shape, 255, np.uint8)
    costs[5, 29:32] = 254
    tinted = tint_costs(plain, grid, costs, view)
    changed = (plain != tinted).any(axis=2)
    columns = np.unique(np.nonzero(changed)[1])
    assert columns.tolist() == [*range(290, 300), *range(310, 320)]  # the obstacle keeps its colour


def test_the_overlay_leaves_void_alone() -> None:
    rgb = np.full((4, 4, 3), 100, np.uint8)
    assert np.array_equal(overlay(rgb, np.full((4, 4), VOID_ID, np.uint8), GRASS_OBSTACLE_PERSON), rgb)
    tinted = overlay(rgb, np.full((4, 4), 2, np.uint8), GRASS_OBSTACLE_PERSON, opacity=1.0)
    assert (tinted == PERSON.color).all()


def test_depth_shows_what_was_not_measured() -> None:
    depth_m = np.array([[np.nan, 1.0, 5.0]], np.float32)
    colors, low, high = depth_colors(depth_m)
    assert tuple(colors[0, 0]) == NO_READING
    assert 1.0 <= low < high <= 5.0
    assert colors[0, 1].sum() > colors[0, 2].sum()  # near is bright
    colors, low, high = depth_colors(np.full((2, 2), np.nan, np.float32))
    assert (colors == NO_READING).all()


def test_what_is_known_fills_the_window() -> None:
    classes = np.zeros((1000, 1000), np.uint8)
    classes[500, 600] = MapClass.GRASS
    grid = OccupancyGrid(GridSpec(0.1, 1000, 1000), classes)
    x_min, x_max, y_min, y_max = bounds_of(grid)
    assert 59 < x_min < 60
    assert 60.1 < x_max < 61
    assert 49 < y_min < 50
    assert 50.1 < y_max < 51
    assert bounds_of(grid, (0.0, 0.0))[0] < 0


def test_the_camera_is_drawn_where_it_looks() -> None:
    view = View.of((-2, 2, 0, 4), 400, 400)
    picture = np.full((400, 400, 3), 255, np.uint8)
    draw_camera(picture, view, CAMERA, frame().intrinsics)  # at (0, 2.5), looking along +x
    rows, columns = np.nonzero((picture < 128).all(axis=2))
    assert columns.min() == pytest.approx(200 - 6, abs=2)
    assert columns.max() > 230
    assert rows.mean() == pytest.approx(150, abs=2)
    far = Pose("map", "camera", CAMERA.matrix + np.eye(4, k=3) * 1e12)
    draw_camera(picture, view, far, None)


def test_text_is_drawn_without_the_outline_font(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawing, "_font", lambda: None)
    drawing.text_width.cache_clear()
    picture = map_picture(grid_with_obstacle())
    drawing.text_width.cache_clear()
    assert (picture[30:50, 24:80] < 128).any()


def test_pictures_are_written_in_rgb(tmp_path: Path) -> None:
    picture = np.zeros((4, 4, 3), np.uint8)
    picture[..., 0] = 255
    write_picture(picture, tmp_path / "red.png")
    back = cv2.imread(str(tmp_path / "red.png"))
    assert back is not None
    assert (back == (0, 0, 255)).all()  # OpenCV reads BGR
    write_picture(picture, tmp_path / "red.jpg")
    with pytest.raises(OutputError, match=r"\.png or \.jpg"):
        write_picture(picture, tmp_path / "red.gif")
