"""The list of costmap layers; the keep-out mask against Nav2's rule, cell by cell."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from swardmap.config import AreaConfig, Config, load_config
from swardmap.errors import ConfigError, InputError, InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.maps import costmap_layers
from swardmap.io.maps.area_files import read_area
from swardmap.io.maps.costmap_layers import LAYERS, SEEN, zone_layers
from swardmap.io.maps.keepout_mask import KeepoutMask, read_keepout
from swardmap.io.maps.map_images import encode_pgm
from swardmap.labels import MapClass
from swardmap.mapping.costmap import build_costmap, layered_costmap

GRID = GridSpec(0.1, 30, 20, (-1.0, -0.5))


def mask_file(folder: Path, grey: NDArray[np.uint8], mode: str = "trinary", origin: str = "0, 0, 0") -> Path:
    """A mask as an image editor saves it: row 0 is the top."""
    (folder / "mask.pgm").write_bytes(encode_pgm(grey))
    (folder / "mask.yaml").write_text(
        f"image: mask.pgm\nmode: {mode}\nresolution: 0.25\norigin: [{origin}]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return folder / "mask.yaml"


def nav2_keepout(master: NDArray[np.uint8], spec: GridSpec, mask: KeepoutMask) -> NDArray[np.uint8]:
    """KeepoutFilter::process of nav2_costmap_2d written down again, mask and costmap in one frame."""
    out = master.copy()
    (ox, oy), r = mask.spec.origin_m, mask.spec.resolution_m
    for j, i in np.ndindex(*master.shape):
        wx, wy = (
            spec.origin_m[0] + (i + 0.5) * spec.resolution_m,
            spec.origin_m[1] + (j + 0.5) * spec.resolution_m,
        )
        if wx < ox or wy < oy:
            continue
        mx, my = int((wx - ox) / r), int((wy - oy) / r)
        if mx >= mask.spec.width or my >= mask.spec.height:
            continue
        data = mask.costs[my, mx]
        if data != 255 and (data > out[j, i] or out[j, i] == 255):
            out[j, i] = data
    return out


@given(
    arrays(np.uint8, (5, 7), elements=st.sampled_from([0, 0, 25, 127, 253, 254, 255])),
    arrays(np.uint8, (20, 30), elements=st.sampled_from([0, 0, 90, 254, 255])),
    st.tuples(st.sampled_from([-1.31, -0.5, 0.02]), st.sampled_from([-0.83, 0.0, 0.41])),
)
def test_on_known_ground_the_mask_is_nav2s_and_unknown_is_never_made_free(
    costs: NDArray[np.uint8], master: NDArray[np.uint8], origin: tuple[float, float]
) -> None:
    mask = KeepoutMask(GridSpec(0.25, 7, 5, origin), costs)
    grid = OccupancyGrid.unknown(GRID)
    ours, nav2 = mask.apply(master, grid), nav2_keepout(master, GRID, mask)
    known = master != 255
    np.testing.assert_array_equal(ours[known], nav2[known])
    np.testing.assert_array_equal(ours[~known], np.where(nav2[~known] >= 253, nav2[~known], 255))


def test_a_mask_from_an_image_keeps_out_and_is_inflated_without_the_margin(tmp_path: Path) -> None:
    grey = np.full((4, 8), 254, np.uint8)
    grey[0, :] = 0  # the top row: y from 0.75 to 1.0
    config = load_config(overrides=[f"area.mask={mask_file(tmp_path, grey)}", "costmap.margin_m=0.3"])
    grid = OccupancyGrid(GRID, np.full(GRID.shape, MapClass.GRASS, np.uint8))
    costs = build_costmap(grid, config.costmap, zone_layers(config)).costs
    y = GRID.center_of(np.stack([np.zeros(20), np.arange(20)], axis=-1))[:, 1]
    column = costs[:, 15]  # x = 0.55
    assert column[y > 1.0][-1] == 0 or (column[(y > 0.75) & (y < 1)] == 254).all()
    assert (column[(y > 0.75) & (y < 1)] == 254).all()
    assert (column[(y > 0.5) & (y < 0.75)] == 253).all()  # the robot's radius of 0.3 m, no margin
    assert (column[y < 0] == 0).all()
    assert (costs[:, 0] == 0).all()  # left of the image nothing is said


def test_beyond_a_keep_in_mask_all_is_lethal(tmp_path: Path) -> None:
    file = mask_file(tmp_path, np.full((4, 8), 254, np.uint8))
    mask = read_keepout(AreaConfig(mask=str(file), mask_beyond=254))
    assert mask is not None
    zone = mask.zone(GRID)
    x, y = np.moveaxis(GRID.center_of(np.argwhere(np.ones(GRID.shape))[:, ::-1]), -1, 0)
    inside = (x > 0) & (x < 2.0) & (y > 0) & (y < 1)
    np.testing.assert_array_equal(zone.ravel() == 0, inside)
    assert (zone.ravel()[~inside] == 254).all()


def test_grey_levels_are_prices_by_map_servers_scale(tmp_path: Path) -> None:
    grey = np.array([[254, 150, 100, 0]], np.uint8)
    mask = read_keepout(AreaConfig(mask=str(mask_file(tmp_path, grey, mode="scale"))))
    assert mask is not None
    assert mask.costs[0, 0] == 0
    assert 0 < mask.costs[0, 1] < mask.costs[0, 2] < 254
    assert mask.costs[0, 3] == 254


def test_a_mask_that_is_turned_or_missing_is_refused(tmp_path: Path) -> None:
    file = mask_file(tmp_path, np.full((4, 8), 254, np.uint8), origin="0, 0, 0.5")
    with pytest.raises(InputError, match="turned"):
        zone_layers(load_config(overrides=[f"area.mask={file}"]))
    with pytest.raises(InputError, match=r"nowhere\.yaml"):
        read_keepout(AreaConfig(mask="nowhere.yaml"))


def test_a_mask_in_another_frame_is_refused(tmp_path: Path) -> None:
    file = mask_file(tmp_path, np.full((4, 8), 254, np.uint8))
    mask = read_keepout(AreaConfig(mask=str(file), frame_id="odom"))
    assert mask is not None
    with pytest.raises(InvalidValueError, match=r"'odom', the map in 'map'.*area.frame_id"):
        build_costmap(OccupancyGrid.unknown(GRID), Config().costmap, [mask])


def test_without_files_only_what_is_seen_is_left() -> None:
    assert zone_layers(Config()) == ()
    assert next(iter(LAYERS)) == SEEN[0]
    assert [*LAYERS][-1] == SEEN[-1]
    config = Config()
    grid = OccupancyGrid(GRID, np.full(GRID.shape, MapClass.GRASS, np.uint8))
    grid.classes[5, 5], grid.classes[:, 20:] = MapClass.OBSTACLE, MapClass.UNKNOWN
    made = [layer for make in LAYERS.values() if (layer := make(config)) is not None]
    one, two = layered_costmap(grid, made), build_costmap(grid, config.costmap)
    np.testing.assert_array_equal(one.costs, two.costs)


def test_a_new_layer_is_one_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    class Everything:
        frame_id = None

        def apply(self, costs: NDArray[np.uint8], grid: OccupancyGrid) -> NDArray[np.uint8]:
            return np.full_like(costs, 7)

    entries = dict(LAYERS)
    last = entries.popitem()
    monkeypatch.setattr(
        costmap_layers, "LAYERS", {**entries, "seven": lambda c: Everything(), last[0]: last[1]}
    )
    layers = zone_layers(Config())
    assert (build_costmap(OccupancyGrid.unknown(GRID), Config().costmap, layers).costs == 7).all()


def test_an_area_in_metres_needs_no_datum(tmp_path: Path) -> None:
    file = tmp_path / "lawn.yaml"
    file.write_text("polygon_m: [[0, 0], [2, 0], [2, 1], [0, 1]]\n")
    area = read_area(AreaConfig(file=str(file)))
    assert area is not None
    assert area.area_m2 == 2
    assert (~area.keep_out(GRID)).sum() == 20 * 10
    with pytest.raises(ConfigError, match="datum_lat"):
        AreaConfig(file="lawn.kml")
    file.write_text("polygon_m: [[0, 0], [2, 1], [2, 0], [0, 1]]\n")
    with pytest.raises(InputError, match="crosses itself"):
        read_area(AreaConfig(file=str(file)))
