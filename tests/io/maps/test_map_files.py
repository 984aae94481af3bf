import io
import os
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swardmap.errors import InputError, OutputError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.maps.map_files import (
    is_costmap,
    read_costmap,
    read_map,
    read_nav_values,
    write_costmap,
    write_map,
)
from swardmap.io.maps.map_images import decode_grey, encode_pgm
from swardmap.io.maps.map_yaml import Mode, nav_value_of_grey
from swardmap.io.maps.npz_files import read_npz, write_npz
from swardmap.labels import MapClass
from swardmap.mapping.costmap import Costmap, occupancy_from_costs

# What Nav2's own test expects of its testmap, lower left cell first (nav2_map_server/test/test_constants.cpp)
NAV2_TESTMAP = """
. . . . . . . . . .
# # # # . . # # # .
# # # # . . # # # .
# . . . . . . . . .
# . . . . . . . . .
# . . . . . # # . .
# . . . . . # # . .
# . . . . . # # . .
# . . . . . # # . .
# . . . . . . . . .
"""

specs = st.builds(
    GridSpec,
    resolution_m=st.floats(1e-4, 10),
    width=st.integers(1, 9),
    height=st.integers(1, 9),
    origin_m=st.tuples(st.floats(-1e7, 1e7), st.floats(-1e7, 1e7)),
    frame_id=st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=8),
)


@st.composite
def grids(draw: st.DrawFn) -> OccupancyGrid:
    spec = draw(specs)
    classes = draw(arrays(np.uint8, spec.shape, elements=st.integers(0, 3)))
    return OccupancyGrid(spec, classes, draw(st.integers(0, 2**63 - 1)))


@st.composite
def costmaps(draw: st.DrawFn) -> Costmap:
    spec = draw(specs)
    return Costmap(spec, draw(arrays(np.uint8, spec.shape)), draw(st.integers(0, 2**63 - 1)))


def description(folder: Path, image: object, **changes: object) -> Path:
    keys = {
        "image": image,
        "resolution": 0.1,
        "origin": [2.0, 3.0, 0.0],
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
        "negate": 0,
        "mode": "trinary",
        **changes,
    }
    path = folder / "map.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in keys.items() if v is not None}))
    return path


def png(array: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".png", array)[1])


@settings(max_examples=40)
@given(grid=grids())
def test_a_map_reads_back_with_nothing_lost(
    tmp_path_factory: pytest.TempPathFactory, grid: OccupancyGrid
) -> None:
    folder = tmp_path_factory.mktemp("map")
    back = read_map(write_map(grid, folder / "map"))
    assert (back.spec, back.stamp_ns) == (grid.spec, grid.stamp_ns)
    assert np.array_equal(back.classes, grid.classes)
    spec, values = read_nav_values(folder / "map.yaml")
    assert spec == grid.spec
    assert np.array_equal(values, grid.nav_values)
    write_npz(grid, folder / "map.npz")
    again = read_npz(folder / "map.npz")
    assert isinstance(again, OccupancyGrid)
    assert (again.spec, again.stamp_ns) == (grid.spec, grid.stamp_ns)
    assert np.array_equal(again.classes, grid.classes)


@settings(max_examples=40)
@given(costmap=costmaps())
def test_a_costmap_reads_back_with_nothing_lost(
    tmp_path_factory: pytest.TempPathFactory, costmap: Costmap
) -> None:
    folder = tmp_path_factory.mktemp("map")
    path = write_costmap(costmap, folder / "costmap.yaml")
    back = read_costmap(path)
    assert (back.spec, back.stamp_ns) == (costmap.spec, costmap.stamp_ns)
    assert np.array_equal(back.costs, costmap.costs)
    assert np.array_equal(read_nav_values(path)[1], occupancy_from_costs(costmap.costs))
    write_npz(costmap, folder / "costmap.npz")
    again = read_npz(folder / "costmap.npz")
    assert isinstance(again, Costmap)
    assert (again.spec, again.stamp_ns) == (costmap.spec, costmap.stamp_ns)
    assert np.array_equal(again.costs, costmap.costs)


@pytest.mark.parametrize("resolution", [0.0625, 1 / 3, 1e-05, 0.05])
def test_resolution_and_origin_keep_their_digits(tmp_path: Path, resolution: float) -> None:
    spec = GridSpec(resolution, 2, 2, (448262.123456789, 5411932.987654321))
    text = write_map(OccupancyGrid.unknown(spec), tmp_path / "map").read_text()
    values = {line.split(": ")[0]: line.split(": ")[1] for line in text.splitlines() if ": " in line}
    assert float(values["resolution"]) == resolution
    assert [float(v) for v in values["origin"].strip("[]").split(",")] == [*spec.origin_m, 0.0]
    assert read_map(tmp_path / "map.yaml").spec == spec


@pytest.mark.parametrize("free", [0.0, 0.1, 0.196, 0.25, 0.4])
@pytest.mark.parametrize("occupied", [0.55, 0.65, 0.9])
@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_unknown_is_never_free_whatever_thresholds_a_loader_has(
    tmp_path: Path, free: float, occupied: float, mode: Mode
) -> None:
    spec = GridSpec(0.1, 4, 1)
    write_map(OccupancyGrid(spec, np.array([[0, 1, 2, 3]], np.uint8)), tmp_path / "map")
    grey, _ = decode_grey((tmp_path / "map.pgm").read_bytes(), "map.pgm")
    unknown, grass, obstacle, person = nav_value_of_grey(mode, False, free, occupied)[grey[0]]
    assert unknown != 0
    assert (obstacle, person) == (100, 100)
    assert grass == 0 or free < 1 / 255
    if mode == "trinary":
        assert unknown == -1


def test_a_costmap_is_safe_for_a_loader_that_does_not_know_mode_raw(tmp_path: Path) -> None:
    costs = np.arange(256, dtype=np.uint8).reshape(16, 16)
    write_costmap(Costmap(GridSpec(0.1, 16, 16), costs), tmp_path / "c")
    grey, _ = decode_grey((tmp_path / "c.pgm").read_bytes(), "c.pgm")
    assert (nav_value_of_grey("trinary", False, 0.25, 0.65)[grey] != 0).all()


def test_the_first_row_of_the_image_is_the_far_end_of_the_map(tmp_path: Path) -> None:
    classes = np.full((3, 2), MapClass.GRASS, np.uint8)
    classes[0, 1] = MapClass.OBSTACLE  # lowest y, highest x: the lower right corner of the picture
    write_map(OccupancyGrid(GridSpec(0.1, 2, 3), classes), tmp_path / "map")
    picture = cv2.imread(str(tmp_path / "map.pgm"), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert picture.tolist() == [[254, 254], [254, 254], [254, 0]]


@pytest.mark.parametrize("suffix", [".pgm", ".png", ".bmp"])
@pytest.mark.parametrize("negate", [0, 1, True, False])
def test_nav2s_own_test_map(tmp_path: Path, suffix: str, negate: int) -> None:
    wanted = np.array(
        [[100 * (c == "#") for c in line.split()] for line in NAV2_TESTMAP.strip().splitlines()]
    )
    occupied, free = (255, 0) if negate else (0, 255)
    picture = np.where(wanted[::-1] == 100, occupied, free).astype(np.uint8)
    (tmp_path / f"testmap{suffix}").write_bytes(bytes(cv2.imencode(suffix, picture)[1]))
    path = description(tmp_path, f"testmap{suffix}", negate=negate, origin=[2.0, 3.0, 1.0])
    spec, values = read_nav_values(path, ignore_yaw=True)
    assert (spec.resolution_m, spec.origin_m, spec.shape) == (0.1, (2.0, 3.0), (10, 10))
    assert np.array_equal(values, wanted)
    with pytest.raises(InputError, match="turned by 1 rad"):
        read_nav_values(path)


# by hand from map_io.cpp: p = 1 - g / 255; 89 -> .65098, 90 -> .64706, 205 -> .19608, 206 -> .19216
KEY_LEVELS = {
    ("trinary", 0.196, 0.65): {0: 100, 89: 100, 90: -1, 128: -1, 204: -1, 205: -1, 206: 0, 254: 0, 255: 0},
    ("trinary", 0.25, 0.65): {0: 100, 89: 100, 90: -1, 191: -1, 192: 0, 205: 0, 255: 0},
    ("scale", 0.196, 0.65): {0: 100, 89: 100, 90: 99, 128: 67, 205: 0, 206: 0, 150: 48, 200: 4},
    ("raw", 0.196, 0.65): {0: 0, 1: 1, 99: 99, 100: 100, 101: -1, 127: -1, 128: -1, 205: -1, 255: -1},
}


@pytest.mark.parametrize(("rule", "wanted"), KEY_LEVELS.items())
def test_key_grey_levels(rule: tuple[Mode, float, float], wanted: dict[int, int]) -> None:
    table = nav_value_of_grey(rule[0], False, *rule[1:])
    assert {g: table[g] for g in wanted} == wanted
    negated = nav_value_of_grey(rule[0], True, *rule[1:])
    if rule[0] == "raw":
        assert np.array_equal(negated, table)
    else:
        assert {g: negated[255 - g] for g in wanted} == wanted


def straightforward(grey: int, mode: str, negate: bool, free: float, occupied: float) -> float:
    """Before rounding."""
    if mode == "raw":
        return grey if grey <= 100 else -1
    p = grey / 255 if negate else (255 - grey) / 255
    if p >= occupied:
        return 100
    if p <= free:
        return 0
    return -1 if mode == "trinary" else (p - free) / (occupied - free) * 100


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize(("free", "occupied"), [(0.196, 0.65), (0.25, 0.65), (0.1, 0.9), (0.001, 0.999)])
def test_every_grey_level(mode: Mode, negate: bool, free: float, occupied: float) -> None:
    wanted = [straightforward(g, mode, negate, free, occupied) for g in range(256)]
    table = nav_value_of_grey(mode, negate, free, occupied)
    # the nearest whole number; at 37.5 it is the rounding of float32, there as here, that decides
    assert np.abs(table - wanted).max() <= 0.5 + 1e-9
    assert mode == "scale" or table.tolist() == wanted


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_transparent_pixels_are_unknown(tmp_path: Path, mode: Mode) -> None:
    picture = np.zeros((1, 3, 4), np.uint8)
    picture[0, :, 3] = 255, 254, 0
    (tmp_path / "m.png").write_bytes(png(picture))
    values = read_nav_values(description(tmp_path, "m.png", mode=mode))[1]
    assert values.tolist() == ([[0, 0, 0]] if mode == "raw" else [[100, -1, -1]])


def test_a_map_of_others_never_becomes_free_where_it_says_something_between(tmp_path: Path) -> None:
    (tmp_path / "m.pgm").write_bytes(encode_pgm(np.array([[0, 1, 50, 99, 100, 101]], np.uint8)))
    grid = read_map(description(tmp_path, "m.pgm", mode="raw"))
    unknown = MapClass.UNKNOWN
    assert grid.classes.tolist() == [[MapClass.GRASS, unknown, unknown, unknown, MapClass.OBSTACLE, unknown]]
    assert grid.count(MapClass.PERSON) == 0


@given(
    pixels=arrays(np.uint8, st.tuples(st.integers(1, 7), st.integers(1, 7))),
    suffix=st.sampled_from([".pgm", ".png", ".bmp"]),
)
def test_images_decode_as_opencv_wrote_them(pixels: np.ndarray, suffix: str) -> None:
    grey, opacity = decode_grey(bytes(cv2.imencode(suffix, pixels)[1]), "x")
    assert np.array_equal(grey, pixels)
    assert opacity is None


@pytest.mark.parametrize(
    ("content", "wanted"),
    [
        (b"P2\n# by hand\n3 1 # more\n255\n0 128\n255", [[0, 128, 255]]),
        (b"P2 3 1 100 0 50 100", [[0, 128, 255]]),
        (b"P5\n# a\n# b\n2 1\n1\n\x00\x01", [[0, 255]]),
        (b"P5 2 1 65535 " + struct.pack(">HH", 65535, 257), [[255, 1]]),
        (b"P5 1 1 255\n\n", [[10]]),
    ],
)
def test_pgm_in_all_its_spellings(content: bytes, wanted: list[list[int]]) -> None:
    assert decode_grey(content, "x.pgm")[0].tolist() == wanted


def test_sixteen_bit_and_colour_images() -> None:
    assert decode_grey(png(np.array([[0, 257, 65535]], np.uint16)), "x")[0].tolist() == [[0, 1, 255]]
    grey = np.full((2, 2, 3), 77, np.uint8)
    assert decode_grey(png(grey), "x")[0].tolist() == [[77, 77], [77, 77]]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image": "none.pgm"}, "none.pgm: No such file"),
        ({"image": "/nowhere/none.pgm"}, "/nowhere/none.pgm: No such file"),
        ({"image": None}, "'image'"),
        ({"image": "a\0b"}, "'image'"),
        ({"resolution": None}, "'resolution'"),
        ({"resolution": "fine"}, "'resolution'"),
        ({"resolution": 0}, "positive resolution"),
        ({"resolution": float("nan")}, "'resolution'"),
        ({"origin": [1, 2]}, r"\[x, y, yaw\]"),
        ({"origin": [1, 2, float("inf")]}, "'origin'"),
        ({"origin": [1, 2, 0.1]}, "turned by 0.1 rad"),
        ({"mode": "binary"}, "trinary, scale or raw"),
        ({"mode": ["raw"]}, "trinary, scale or raw"),
        ({"negate": None}, "'negate'"),
        ({"free_thresh": 0.7}, "free_thresh below occupied_thresh"),
        ({"swardmap": {"stamp_ns": "now"}}, "stamp_ns"),
    ],
)
def test_a_wrong_description_is_one_clear_error(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    (tmp_path / "m.pgm").write_bytes(encode_pgm(np.zeros((2, 2), np.uint8)))
    with pytest.raises(InputError, match=message):
        read_map(description(tmp_path, **{"image": "m.pgm", **changes}))


@pytest.mark.parametrize("text", ["", "- a\n- b", "{", "a: !!python/object:os.system x", "\x00", "[" * 5000])
def test_a_file_that_is_no_description_is_one_clear_error(tmp_path: Path, text: str) -> None:
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(InputError, match=r"map\.yaml"):
        read_map(tmp_path / "map.yaml")


@pytest.mark.parametrize("suffix", [".pgm", ".png", ".bmp"])
def test_a_truncated_image_is_never_a_map(suffix: str) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (20, 20), np.uint8)
    whole = bytes(cv2.imencode(suffix, picture)[1])
    for length in range(len(whole)):
        with pytest.raises(InputError):
            decode_grey(whole[:length], "x")


@pytest.mark.parametrize(
    "content",
    [
        b"P5 99999999 99999999 255\n",
        b"P2 3 1 255 1 2 x",
        b"P2 3 1 255 1 2 -3",
        b"P2 2 1 9 1 10",
        b"P5 0 5 255\n",
        b"P5 5",
        b"P5 # never ends",
        b"BM" + bytes(30),
        b"GIF89a",
    ],
)
def test_a_hostile_image_is_one_clear_error(content: bytes) -> None:
    with pytest.raises(InputError):
        decode_grey(content, "x")


@given(
    content=st.binary(max_size=200),
    magic=st.sampled_from([b"", b"P5 ", b"P2 2 2 ", b"BM", b"\x89PNG\r\n\x1a\n"]),
)
def test_random_bytes_are_an_image_or_a_clear_error(content: bytes, magic: bytes) -> None:
    try:
        grey, _ = decode_grey(magic + content, "x")
    except InputError:
        return
    assert grey.ndim == 2


def test_images_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    spec = GridSpec(0.1, 2, 1)
    path = write_costmap(Costmap(spec, np.array([[0, 254]], np.uint8)), tmp_path / "c")
    assert is_costmap(path)
    (tmp_path / "c_costs.pgm").write_bytes(encode_pgm(np.array([[0, 0]], np.uint8)))
    with pytest.raises(InputError, match="contradicts"):
        read_costmap(path)
    (tmp_path / "c_costs.pgm").write_bytes(encode_pgm(np.array([[0], [0]], np.uint8)))
    with pytest.raises(InputError, match="expected the size"):
        read_costmap(path)


def test_a_costmap_cannot_point_out_of_its_folder(tmp_path: Path) -> None:
    (tmp_path / "m.pgm").write_bytes(encode_pgm(np.zeros((1, 1), np.uint8)))
    with pytest.raises(InputError, match="inside"):
        read_costmap(description(tmp_path, "m.pgm", swardmap={"costs": "../../etc/passwd"}))


def test_a_map_is_no_costmap(tmp_path: Path) -> None:
    path = write_map(OccupancyGrid.unknown(GridSpec(0.1, 1, 1)), tmp_path / "map")
    assert not is_costmap(path)
    with pytest.raises(InputError, match="expected a costmap"):
        read_costmap(path)


def test_an_absolute_image_name_is_read(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    image = tmp_path / "elsewhere" / "m.pgm"
    image.write_bytes(encode_pgm(np.full((1, 1), 254, np.uint8)))
    assert read_map(description(tmp_path, str(image))).classes.tolist() == [[MapClass.GRASS]]


def test_a_map_that_cannot_be_written_leaves_the_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = GridSpec(0.1, 1, 1)
    write_map(OccupancyGrid(spec, np.array([[MapClass.PERSON]], np.uint8)), tmp_path / "map")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        write_map(OccupancyGrid.unknown(spec), tmp_path / "map")
    assert read_map(tmp_path / "map.yaml").classes.tolist() == [[MapClass.PERSON]]


def test_npz_files_of_others_are_one_clear_error(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    for content in (b"", b"PK\x03\x04", b"random"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"x\.npz"):
            read_npz(path)
    good = {"resolution_m": 0.1, "origin_m": [0.0, 0.0], "frame_id": "map", "stamp_ns": 0}
    for cells in (
        np.full((2, 2), 9, np.uint8),
        np.zeros(4, np.uint8),
        np.zeros((2, 2)),
        np.array(["x"], object),
    ):
        buffer = io.BytesIO()
        np.savez(buffer, classes=cells, **good)  # type: ignore[arg-type]
        path.write_bytes(buffer.getvalue())
        with pytest.raises(InputError, match=r"x\.npz"):
            read_npz(path)


@pytest.mark.skipif("SWARDMAP_NAV2" not in os.environ, reason="SWARDMAP_NAV2: a checkout of navigation2")
@pytest.mark.parametrize("suffix", ["pgm", "png", "bmp"])
def test_the_files_of_nav2(tmp_path: Path, suffix: str) -> None:
    folder = Path(os.environ["SWARDMAP_NAV2"]) / "nav2_map_server" / "test"
    wanted = np.array(
        [[100 * (c == "#") for c in line.split()] for line in NAV2_TESTMAP.strip().splitlines()]
    )
    path = description(tmp_path, str(folder / f"testmap.{suffix}"))
    assert np.array_equal(read_nav_values(path)[1], wanted)


@pytest.mark.parametrize(
    ("mode", "yaw"),
    [("Trinary", "0.0"), ("trinary", "1e-17"), ("SCALE", "6.283185307179586"), ("Raw", "-1e-9")],
)
def test_spellings_that_map_server_takes(mode: str, yaw: str, tmp_path: Path) -> None:
    (tmp_path / "m.pgm").write_bytes(encode_pgm(np.full((2, 3), 254, np.uint8)))
    (tmp_path / "m.yaml").write_text(
        f"image: m.pgm\nmode: {mode}\nresolution: 0.05\norigin: [-1.0, -2.0, {yaw}]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    spec, _ = read_nav_values(tmp_path / "m.yaml")
    assert spec.origin_m == (-1.0, -2.0)
