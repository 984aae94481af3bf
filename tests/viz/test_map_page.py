"""The page of a map: its layers are the cells, it stands alone, it escapes, and it works in a browser."""

from base64 import b64decode
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.config import CostmapConfig, config_from_dict
from swardmap.geometry import Intrinsics, Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.mapping.costmap import build_costmap
from swardmap.runs.recording import map_recording
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.types import Frame, Segmentation
from swardmap.viz import map_layers as layers_module
from swardmap.viz.map_album import MOST_FRAMES, MOST_PLACES, Album
from swardmap.viz.map_layers import bounded_layers, map_layers
from swardmap.viz.map_page import MOST_BYTES, map_page
from tests.browser import browser, serious_faults

__all__ = ["browser"]

SUMMARY: dict[str, Any] = {
    "frames": 3,
    "source": {"name": "<script>alert(1)</script>"},
    "skipped": {"<b>": 2},
}


def decoded(url: str) -> NDArray[Any]:
    image = cv2.imdecode(np.frombuffer(b64decode(url.split(",")[1]), np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return np.asarray(image)


def some_map() -> OccupancyGrid:
    classes = np.random.default_rng(1).choice(4, (30, 40), p=[0.3, 0.6, 0.07, 0.03]).astype(np.uint8)
    return OccupancyGrid(GridSpec(0.1, 40, 30, (-1.0, 2.0)), classes)


def test_layers_hold_each_cell_where_it_lies() -> None:
    grid = some_map()
    costmap = build_costmap(grid, CostmapConfig(margin_m=0.1))
    layers = {layer.name: decoded(layer.url)[::-1, :, 3] > 0 for layer in map_layers(grid, costmap)}
    for name, map_class in (
        ("grass", MapClass.GRASS),
        ("obstacle", MapClass.OBSTACLE),
        ("person", MapClass.PERSON),
    ):
        np.testing.assert_array_equal(layers[name], grid.classes == map_class)
    costs = [layers[name] for name in ("cost", "inscribed", "margin") if name in layers]
    np.testing.assert_array_equal(
        np.logical_or.reduce(costs), (costmap.costs > 0) & (costmap.costs < 255) & ~grid.is_obstacle
    )
    assert np.sum(costs, axis=0).max() == 1


def test_no_obstacle_of_a_large_map_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layers_module, "MAX_SIDE", 12)
    classes = np.ones((31, 40), np.uint8)
    classes[30, 39], classes[7, 3] = MapClass.OBSTACLE, MapClass.PERSON
    made, step = bounded_layers(OccupancyGrid(GridSpec(0.1, 40, 31), classes), None)
    assert step == 4
    layers = {x.name: decoded(x.url) for x in made}
    assert layers["grass"].shape[:2] == (8, 10)
    assert [tuple(p) for p in np.argwhere(layers["obstacle"][::-1, :, 3])] == [(7, 9)]
    assert [tuple(p) for p in np.argwhere(layers["person"][::-1, :, 3])] == [(1, 0)]


def test_a_map_that_does_not_compress_is_told_more_coarsely(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layers_module, "MOST_BYTES", 40_000)
    noise = np.random.default_rng(2).integers(0, 4, (300, 300)).astype(np.uint8)
    layers, step = bounded_layers(OccupancyGrid(GridSpec(0.1, 300, 300), noise), None)
    assert step > 1
    assert sum(len(layer.url) for layer in layers) <= 40_000


def test_an_album_of_any_length_stays_small_and_even(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, mask = flat_lawn
    album, count = Album(step_m=0.0), 700
    for i in range(count):
        pose = Pose("map", "camera", np.eye(4) + np.outer([0.1 * i, 0, 0, 0], [0, 0, 0, 1.0]))
        album.add(replace(frame, stamp_ns=i, T_map_camera=pose), mask, some_map(), pose)
    kept = [f.index for f in album.frames]
    assert MOST_FRAMES / 2 <= len(kept) <= MOST_FRAMES
    assert kept[0] == 0
    assert len(set(np.diff(kept).tolist())) == 1
    assert count - kept[-1] <= np.diff(kept)[0]
    assert len(album.way_m) == count
    assert album.frames[3].xy_m is not None
    assert album.frames[3].xy_m[0] == pytest.approx(0.1 * kept[3])


def test_the_way_of_an_endless_drive_is_bounded(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, mask = flat_lawn
    album = Album(pictures=False)
    album.way_m = [(float(i), 0.0) for i in range(MOST_PLACES)]
    far = Pose("map", "camera", np.eye(4) + np.outer([1e6, 0, 0, 0], [0, 0, 0, 1.0]))
    album.add(replace(frame, T_map_camera=far), mask, some_map(), far)
    assert len(album.way_m) == MOST_PLACES // 2 + 1
    assert album.way_m[-1] == (1e6, 0.0)
    assert album.frames == []


def test_a_page_stays_below_its_limit(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, mask = flat_lawn
    assert frame.T_map_camera is not None
    album = Album()
    album.add(replace(frame, T_map_camera=None), mask, some_map(), frame.T_map_camera)
    assert album.way_m == []
    one = album.frames[0]
    album.frames = [replace(one, photo="x" * (MOST_BYTES // 10), index=i) for i in range(30)]
    html = map_page(None, None, album, SUMMARY, "")
    assert len(html) < MOST_BYTES
    assert html.count('"index":') in range(3, 9)


def test_the_page_stands_alone_and_escapes_what_it_is_told(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, mask = flat_lawn
    album = Album()
    assert frame.T_map_camera is not None
    named = replace(frame, name="</script><script>alert(2)//")
    album.add(named, mask, some_map(), frame.T_map_camera)
    html = map_page(some_map(), None, album, SUMMARY, "a: <i>", "swardmap map 'a & <u>'")
    assert html.count("<script") == 2  # ours: the data, the program
    assert html.count("</script>") == 2
    for hostile in ("alert(1)</", "<em>", "<i>", "<u>"):
        assert hostile not in html
    for outside in ("https://", 'src="/', "@import", "url("):
        assert outside not in html
    assert html.replace("http://www.w3.org/2000/svg", "").count("http://") == 0


@pytest.mark.parametrize("summary", [{"frames": {"front": 2, "rear": 3}, "skipped": {}}, {"frames": 0}])
def test_a_node_saves_a_page_of_what_it_knows(summary: dict[str, Any]) -> None:
    html = map_page(some_map(), None, Album(pictures=False), summary, "")
    assert "Map of this drive" in html
    assert 'id="frames"' not in html


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("page") / "out"
    settings = {"segmenter": {"name": "truth"}, "costmap": {"margin_m": 0.1}}
    source = AnalyticSource(
        garden_scene(0), tuple(lane_poses(4, step_m=0.4)), Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
    )
    map_recording(source, out, config_from_dict(settings))
    return out / "report.html"


@pytest.fixture
def page_without_map(flat_lawn: tuple[Frame, Segmentation], tmp_path: Path) -> Path:
    frame, mask = flat_lawn
    assert frame.T_map_camera is not None
    album = Album()
    album.add(replace(frame, T_map_camera=None), mask, some_map(), frame.T_map_camera)
    reason = "depth image that is missing, truncated or of another size than its colour image"
    summary = {
        "frames": 1, "frames_without_pose": 1, "skipped": {reason: 12_345},
        "pixels": {"pixels": 10, "no_reading": 4, "used": 6},
        "timings_ms": {"segment": {"p50": 1.0, "mean": 2.0, "p99": 3.0}},
    }  # fmt: skip
    path = tmp_path / "alone.html"
    path.write_text(map_page(None, None, album, summary, "a: 1\n" * 200), encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("which", ["page", "page_without_map"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_in_chromium_it_fits_and_has_no_serious_fault(
    which: str, browser: Any, width: int, scheme: str, request: pytest.FixtureRequest
) -> None:
    page: Path = request.getfixturevalue(which)
    tab = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
    requests: list[str] = []
    messages: list[str] = []
    tab.on("request", lambda request: requests.append(request.url))
    tab.on("console", lambda message: messages.append(message.text))
    tab.on("pageerror", lambda error: messages.append(str(error)))
    tab.goto(page.as_uri())
    assert [url for url in requests if not url.startswith("data:")] == [page.as_uri()]
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert tab.evaluate("[...document.images].every(i => i.complete && i.naturalWidth > 0)")
    assert serious_faults(tab) == []
    assert messages == []
    tab.close()


@pytest.mark.slow
def test_layers_switch_and_the_map_moves_and_zooms(page: Path, browser: Any) -> None:
    tab = browser.new_page(viewport={"width": 1000, "height": 900})
    tab.goto(page.as_uri())
    for name in tab.eval_on_selector_all("[data-layer]", "boxes => boxes.map(b => b.dataset.layer)"):
        layer = tab.locator(f'#map-svg [data-name="{name}"]')
        tab.uncheck(f'[data-layer="{name}"]')
        assert layer.get_attribute("display") == "none"
        tab.check(f'[data-layer="{name}"]')
        assert layer.get_attribute("display") == "inline"

    def view() -> list[float]:
        return [float(v) for v in tab.locator("#map-svg").get_attribute("viewBox").split()]

    home = view()
    box = tab.locator("#map-svg").bounding_box()
    assert home[2] / home[3] == pytest.approx(box["width"] / box["height"], rel=0.01)  # cells are square
    tab.click('[data-do="in"]')
    assert view()[2] == pytest.approx(0.7 * home[2])
    tab.click('[data-do="fit"]')
    assert view() == home
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    tab.mouse.move(*middle)
    tab.mouse.down()
    tab.mouse.move(middle[0] + 100, middle[1] - 50)
    tab.mouse.up()
    metres = home[2] / box["width"]
    assert view()[:2] == pytest.approx([home[0] - 100 * metres, home[1] + 50 * metres], abs=2 * metres)
    tab.keyboard.down("Control")
    tab.mouse.wheel(0, -300)
    tab.keyboard.up("Control")
    assert view()[2] < home[2]
    tab.focus("#map-svg")
    tab.keyboard.press("0")
    assert view() == home
    assert tab.locator("#map-axes text").count() > 6
    tab.close()


@pytest.mark.slow
def test_the_slider_shows_each_frame_and_where_it_was_taken(page: Path, browser: Any) -> None:
    tab = browser.new_page(viewport={"width": 1000, "height": 900})
    tab.goto(page.as_uri())
    photos, places = set(), set()
    for _ in range(4):
        photos.add(tab.locator("#frame-photo").get_attribute("src"))
        places.add(tab.locator("#map-camera path").get_attribute("transform"))
        tab.click('[data-step="1"]')
    assert (len(photos), len(places)) == (4, 4)
    tab.focus("#frame-slider")
    tab.keyboard.press("Home")
    assert tab.locator("#frame-photo").get_attribute("src") in photos
    tab.emulate_media(media="print")
    assert not tab.locator(".map-buttons").is_visible()
    assert tab.locator("#map-svg").is_visible()
    tab.close()
