"""`swardmap map` with a work area, and going on from a saved living map."""

import json
from pathlib import Path

import numpy as np
import pytest

from swardmap.cli.app import run
from swardmap.geometry import Intrinsics
from swardmap.io.maps.map_files import read_costmap, read_map
from swardmap.io.sources.folder import write_folder
from swardmap.labels import MapClass
from swardmap.mapping.costmap import LETHAL
from swardmap.mapping.geodesy import Projection
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
DATUM = Projection(52.4, 16.9, heading_deg=20.0)
DATUM_FLAGS = [f"area.datum_{key}" for key in ("lat=52.4", "lon=16.9", "heading_deg=20")]


def flags(*settings: str) -> list[str]:
    return [word for setting in settings for word in ("--set", setting)]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("area") / "rec"
    write_folder(AnalyticSource(garden_scene(0), tuple(lane_poses(8, step_m=0.4)), SMALL), path)
    return path


def mapped(recording: Path, out: Path, *options: str) -> int:
    return run(["map", str(recording), "-o", str(out), "--segmenter", "truth", "--pictures", "0", *options])


def lawn(folder: Path, x0: float, x1: float, y0: float, y1: float) -> Path:
    pytest.importorskip("pyproj", reason="needs pip install 'swardmap[gps]'")
    ring = DATUM.to_gps([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]).tolist()
    file = folder / "lawn.geojson"
    file.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    return file


def test_the_area_is_in_the_costmap_and_not_in_the_map(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = lawn(tmp_path, 1.0, 5.0, -1.0, 1.0)
    area = flags(f"area.file={file}", *DATUM_FLAGS)
    assert mapped(recording, tmp_path / "without") == 0
    assert mapped(recording, tmp_path / "with", *area) == 0
    grid, plain = read_map(tmp_path / "with/map.yaml"), read_map(tmp_path / "without/map.yaml")
    np.testing.assert_array_equal(grid.classes, plain.classes)  # the map says what was seen
    costs = read_costmap(tmp_path / "with/costmap.yaml").costs
    spec = grid.spec
    iy, ix = np.indices(spec.shape)
    x, y = np.moveaxis(spec.center_of(np.stack([ix, iy], axis=-1)), -1, 0)
    outside = (x < 1) | (x > 5) | (y < -1) | (y > 1)
    edge = np.min([abs(x - 1), abs(x - 5), abs(y + 1), abs(y - 1)], axis=0) < 1e-3
    assert (costs[outside & ~edge] == LETHAL).all()
    free = costs[~outside & (grid.classes == MapClass.GRASS)] < 253
    assert free.sum() > 200
    assert not (costs[grid.classes == MapClass.UNKNOWN] == 0).any()
    summary = json.loads((tmp_path / "with/summary.json").read_text())["work_area"]
    assert summary["boundary_m2"] == pytest.approx(8, abs=0.01)
    assert summary["kept_out_cells"] == pytest.approx(int(outside.sum()), abs=int(edge.sum()))


@pytest.mark.parametrize(
    ("content", "settings", "words"),
    [
        ("{}", (), "lacks 'type'"),
        (None, ("area.frame_id=odom",), "set area.frame_id"),
        (None, ("area.datum_lat=53.4",), "20 km from the datum"),
    ],
)
def test_an_area_that_does_not_fit_gives_one_line_and_no_map(
    content: str | None, settings: tuple[str, ...], words: str,
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    file = lawn(tmp_path, 1.0, 5.0, -1.0, 1.0)
    if content is not None:
        file.write_text(content)
    assert mapped(recording, tmp_path / "out", *flags(f"area.file={file}", *DATUM_FLAGS, *settings)) == 1
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_map_goes_on_where_it_ended(recording: Path, tmp_path: Path) -> None:
    evidence = flags("grid.mode=evidence")
    assert mapped(recording, tmp_path / "whole", *evidence) == 0
    assert mapped(recording, tmp_path / "first", *evidence, *flags("source.stop=4")) == 0
    living = tmp_path / "first/living.npz"
    assert mapped(recording, tmp_path / "rest", "--resume-map", str(living), *flags("source.start=4")) == 0
    (note,) = json.loads((tmp_path / "rest/summary.json").read_text())["notes"]
    assert note.startswith("--resume-map goes on as grid.mode log_odds; the settings say last")
    whole, rest = read_map(tmp_path / "whole/map.yaml"), read_map(tmp_path / "rest/map.yaml")
    first = read_map(tmp_path / "first/map.yaml")
    assert whole.spec == rest.spec
    np.testing.assert_array_equal(whole.classes, rest.classes)
    assert first.count(MapClass.GRASS) < rest.count(MapClass.GRASS)
    with np.load(tmp_path / "whole/living.npz") as a, np.load(tmp_path / "rest/living.npz") as b:
        order_a, order_b = np.lexsort(a["keys"].T), np.lexsort(b["keys"].T)
        for name in ("keys", "evidence", "person", "classes"):
            np.testing.assert_array_equal(a[name][order_a], b[name][order_b])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("grid.resolution_m=0.1",), "those of this map 0.1 m"),
        (("grid.origin_m=[1, 1]", "grid.size_m=[5, 5]"), "from (1.0, 1.0)"),
    ],
)  # fmt: skip
def test_a_map_on_other_cells_or_a_damaged_one_is_refused(
    settings: tuple[str, ...], words: str, recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert mapped(recording, tmp_path / "first", *flags("grid.mode=evidence", "source.stop=2")) == 0
    living = tmp_path / "first/living.npz"
    assert mapped(recording, tmp_path / "out", "--resume-map", str(living), *flags(*settings)) == 1
    assert words in capsys.readouterr().err
    living.write_bytes(living.read_bytes()[:1000])
    assert mapped(recording, tmp_path / "out", "--resume-map", str(living)) == 1
    assert "expected a living map" in capsys.readouterr().err
    assert mapped(recording, tmp_path / "out", *flags(f"grid.resume={living}")) == 1
    assert "mode: log_odds" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
