import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from swardmap.cli.convert import convert
from swardmap.errors import InputError, OutputError, SwardmapError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.clouds.cloud_files import read_cloud, write_cloud
from swardmap.io.maps.map_files import read_costmap, read_map, write_costmap, write_map
from swardmap.labels import GRASS_OBSTACLE_PERSON, VOID_ID
from swardmap.mapping.costmap import Costmap
from swardmap.types import LabeledCloud

APP = typer.Typer(pretty_exceptions_enable=False)
APP.command()(convert)
SPEC = GridSpec(0.0625, 4, 3, (448262.5, -2.0))
GRID = OccupancyGrid(SPEC, np.arange(12, dtype=np.uint8).reshape(3, 4) % 4, 123)
COSTMAP = Costmap(SPEC, np.arange(244, 256, dtype=np.uint8).reshape(3, 4), 123)
CLOUD = LabeledCloud(
    np.array([[1, 2, 3], [4, 5, 6]], np.float32), np.array([1, 2], np.uint8), "odom", GRASS_OBSTACLE_PERSON, 7
)


def run(*arguments: str | Path) -> str:
    result = CliRunner().invoke(APP, [str(a) for a in arguments])
    if isinstance(result.exception, SwardmapError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def test_a_map_there_and_back(tmp_path: Path) -> None:
    write_map(GRID, tmp_path / "a")
    assert "map" in run(tmp_path / "a.yaml", tmp_path / "b.npz")
    told = json.loads(run(tmp_path / "b.npz", tmp_path / "c.yaml", "--json"))
    assert told == {
        "kind": "map", "written": str(tmp_path / "c.yaml"), "width": 4, "height": 3, "resolution_m": 0.0625,
        "unknown": 3, "grass": 3, "obstacle": 3, "person": 3,
    }  # fmt: skip
    back = read_map(tmp_path / "c.yaml")
    assert (back.spec, back.stamp_ns) == (GRID.spec, GRID.stamp_ns)
    assert np.array_equal(back.classes, GRID.classes)


def test_a_costmap_there_and_back(tmp_path: Path) -> None:
    write_costmap(COSTMAP, tmp_path / "a")
    run(tmp_path / "a.yaml", tmp_path / "b.npz")
    assert "costmap" in run(tmp_path / "b.npz", tmp_path / "c.yaml")
    back = read_costmap(tmp_path / "c.yaml")
    assert back.spec == SPEC
    assert np.array_equal(back.costs, COSTMAP.costs)


def test_pictures(tmp_path: Path) -> None:
    write_map(GRID, tmp_path / "map")
    write_costmap(COSTMAP, tmp_path / "costmap")
    for name in ("map", "costmap"):
        run(tmp_path / f"{name}.yaml", tmp_path / f"{name}.png")
        picture = cv2.imread(str(tmp_path / f"{name}.png"))
        assert picture is not None
        assert picture.shape[1] == 1280


@pytest.mark.parametrize("names", [("a.pcd", "b.ply"), ("a.ply", "b.pcd")])
@pytest.mark.parametrize("extra", [[], ["--ascii"]])
def test_a_cloud_there_and_back(tmp_path: Path, names: tuple[str, str], extra: list[str]) -> None:
    write_cloud(CLOUD, tmp_path / names[0])
    assert "points 2" in run(tmp_path / names[0], tmp_path / names[1], *extra)
    back = read_cloud(tmp_path / names[1])
    assert (back.frame_id, back.stamp_ns, back.label_set) == ("odom", 7, GRASS_OBSTACLE_PERSON)
    assert np.array_equal(back.xyz, CLOUD.xyz)
    assert np.array_equal(back.labels, CLOUD.labels)


def test_a_foreign_cloud_with_a_word_about_its_ids(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(np.arange(12, dtype="<f4").tobytes())
    (tmp_path / "a.label").write_bytes(np.array([72, 30, 50], "<u4").tobytes())
    with pytest.raises(InputError, match="label ids 30, 50, 72"):
        run(tmp_path / "a.bin", tmp_path / "a.pcd")
    run(
        tmp_path / "a.bin",
        tmp_path / "a.pcd",
        "--class",
        "72=grass",
        "--class",
        "*=other",
        "--frame",
        "velodyne",
    )
    back = read_cloud(tmp_path / "a.pcd")
    assert back.labels.tolist() == [1, 0, 0]
    assert back.frame_id == "velodyne"


def test_an_annotated_cloud(tmp_path: Path) -> None:
    write_cloud(CLOUD, tmp_path / "a.pcd")
    (tmp_path / "names.txt").write_text("1: lawn\n2: man\n")
    options = ["--names", str(tmp_path / "names.txt"), "--class", "lawn=grass", "--class", "man=person"]
    run(tmp_path / "a.pcd", tmp_path / "b.ply", *options)
    assert read_cloud(tmp_path / "b.ply").labels.tolist() == [1, 2]


def test_annotations_to_masks(tmp_path: Path) -> None:
    folder = tmp_path / "cvat"
    (folder / "SegmentationClass").mkdir(parents=True)
    (folder / "labelmap.txt").write_text("background:0,0,0::\nlawn:0,200,0::\n")
    image = np.array([[[0, 0, 0], [0, 200, 0]]], np.uint8)
    cv2.imwrite(str(folder / "SegmentationClass" / "a.png"), image)
    told = run(folder, tmp_path / "masks", "--class", "lawn=grass")
    assert "images 1" in told
    assert "grass 1" in told
    mask = cv2.imread(str(tmp_path / "masks" / "a.png"), cv2.IMREAD_UNCHANGED)
    assert mask is not None
    assert mask.tolist() == [[VOID_ID, 1]]
    with pytest.raises(OutputError, match="--overwrite"):
        run(folder, tmp_path / "masks", "--class", "lawn=grass")
    run(folder, tmp_path / "masks", "--class", "lawn=other", "--overwrite")
    (folder / "SegmentationClass" / "b.png").write_bytes(b"broken")
    with pytest.raises(InputError, match=r"b\.png"):
        run(folder, tmp_path / "new", "--class", "lawn=grass")
    assert not (tmp_path / "new").exists()


def test_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    write_map(GRID, tmp_path / "a")
    (tmp_path / "b.npz").write_bytes(b"precious")
    with pytest.raises(OutputError, match="--overwrite"):
        run(tmp_path / "a.yaml", tmp_path / "b.npz")
    assert (tmp_path / "b.npz").read_bytes() == b"precious"
    run(tmp_path / "a.yaml", tmp_path / "b.npz", "--overwrite")
    (tmp_path / "c.pgm").write_bytes(b"precious")
    with pytest.raises(OutputError, match=r"c\.pgm exists"):
        run(tmp_path / "b.npz", tmp_path / "c.yaml")
    with pytest.raises(OutputError, match="the same"):
        run(tmp_path / "a.yaml", tmp_path / "a.yaml", "--overwrite")


@pytest.mark.parametrize(
    ("source", "target"), [("none.yaml", "b.npz"), ("x.txt", "b.npz"), ("a.yaml", "b.pcd")]
)
def test_what_does_not_fit_is_one_clear_error(tmp_path: Path, source: str, target: str) -> None:
    write_map(GRID, tmp_path / "a")
    (tmp_path / "x.txt").write_text("")
    with pytest.raises(SwardmapError, match=r"no such file|expected|not a recording"):
        run(tmp_path / source, tmp_path / target)
    assert not (tmp_path / target).exists()


@pytest.mark.parametrize("word", ["grass", "=grass", "72=", "lawn=grass"])
def test_wrong_use_exits_with_2(tmp_path: Path, word: str) -> None:
    write_cloud(CLOUD, tmp_path / "a.pcd")
    arguments = [str(tmp_path / "a.pcd"), str(tmp_path / "b.ply"), "--class", word]
    assert CliRunner().invoke(APP, arguments).exit_code == 2


def test_help_shows_an_example() -> None:
    assert "swardmap convert map.yaml map.png" in run("--help")


def test_a_recording_becomes_a_folder_and_images(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from swardmap.cli.app import run as swardmap
    from swardmap.io import open_source

    made = "analytic:scenes=1,frames=7,width=64"
    assert swardmap(["convert", made, str(tmp_path / "all")]) == 0
    whole = list(open_source(made))
    back = list(open_source(tmp_path / "all"))
    assert [f.name for f in back] == [f.name for f in whole]
    np.testing.assert_array_equal(back[3].rgb, whole[3].rgb)
    assert (
        swardmap(["convert", str(tmp_path / "all"), str(tmp_path / "images"), "--every", "3", "--images"])
        == 0
    )
    assert sorted(p.stem for p in (tmp_path / "images").glob("*.png")) == [f.name for f in whole[::3]]
    first_ns = whole[0].stamp_ns
    at_s = [(f.stamp_ns - first_ns) / 1e9 for f in whole]
    span = ["--from", str(at_s[2]), "--to", str(at_s[5]), "--json"]
    capsys.readouterr()
    assert swardmap(["convert", made, str(tmp_path / "part"), *span]) == 0
    assert '"frames": 3' in capsys.readouterr().out
    assert [f.name for f in open_source(tmp_path / "part")] == [f.name for f in whole[2:5]]
    assert swardmap(["convert", made, str(tmp_path / "none"), "--from", "1e6"]) == 1
    assert not (tmp_path / "none").exists()
    assert swardmap(["convert", str(tmp_path / "all"), str(tmp_path / "part")]) == 1  # it is there
