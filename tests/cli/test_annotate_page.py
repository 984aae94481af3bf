"""The commands of docs/annotate.md, run in their order on a drive whose true masks are known."""

import json
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.cli.app import run
from swardmap.geometry import Intrinsics
from swardmap.io.annotations.annotation_files import read_masks
from swardmap.io.maps.map_files import read_costmap
from swardmap.io.maps.margin_file import read_margin
from swardmap.io.sources.folder import write_folder
from swardmap.synth.analytic import AnalyticSource, StereoNoise, garden_scene, lane_poses

PAGE = Path(__file__).parents[2] / "docs" / "annotate.md"
NAMES = {0: "verge", 1: "lawn", 2: "man"}
SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)


def commands() -> list[list[str]]:
    blocks = PAGE.read_text(encoding="utf-8").split("```console\n")[1:]
    lines = [line for block in blocks for line in block.split("```")[0].splitlines() if line.strip()]
    assert all(line.startswith("swardmap ") for line in lines)
    return [shlex.split(line)[1:] for line in lines]


def outlines(mask: NDArray[np.uint8]) -> list[tuple[str, NDArray[np.float64]]]:
    """What a person would draw: the lawn with everything in it, then things over it."""
    drawn = []
    for value in (1, 0, 2):
        found, _ = cv2.findContours(
            (mask == value).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        drawn += [(NAMES[value], c[:, 0] + 0.5) for c in found if len(c) >= 3]
    return drawn


def export(folder: Path, drawn: dict[str, list[tuple[str, NDArray[np.float64]]]]) -> None:
    """The same drawings as CVAT, Label Studio and Roboflow write them."""
    w, h = SMALL.width, SMALL.height
    cvat, tasks = "", []
    for name, shapes in drawn.items():
        points = [(label, ";".join(f"{x:.2f},{y:.2f}" for x, y in c)) for label, c in shapes]
        body = "".join(
            f'<polygon label="{label}" points="{p}" z_order="{z}"/>' for z, (label, p) in enumerate(points)
        )
        cvat += f'<image name="{name}.png" width="{w}" height="{h}">{body}</image>'
        percent = [(label, (c * [100 / w, 100 / h]).tolist()) for label, c in shapes]
        results = [
            {"type": "polygonlabels", "original_width": w, "original_height": h,
             "value": {"polygonlabels": [label], "points": p}}
            for label, p in percent
        ]  # fmt: skip
        upload = f"/data/upload/1/0a1b2c3d-{name}.png"
        tasks.append({"data": {"image": upload}, "annotations": [{"result": results}]})
    (folder / "annotations.xml").write_text(f"<annotations>{cvat}</annotations>")
    (folder / "project.json").write_text(json.dumps(tasks))
    categories = ["things", *NAMES.values()]
    images = [
        {"id": i, "file_name": f"{n}_png.rf.0a1b2c3d4e5f.jpg", "width": w, "height": h}
        for i, n in enumerate(drawn)
    ]
    annotations = [
        {"image_id": i, "category_id": categories.index(label), "segmentation": [c.ravel().tolist()]}
        for i, shapes in enumerate(drawn.values())
        for label, c in shapes
    ]
    tree = {
        "images": images,
        "annotations": annotations,
        "categories": [{"id": i, "name": n} for i, n in enumerate(categories)],
    }
    (folder / "roboflow" / "train").mkdir(parents=True)
    (folder / "roboflow" / "train" / "_annotations.coco.json").write_text(json.dumps(tree))


@pytest.mark.slow
def test_every_command_of_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SWARDMAP_GRID__MIN_GRASS_POINTS", "1")  # so that eight small frames miss some cells
    source = AnalyticSource(garden_scene(1), tuple(lane_poses(16, step_m=0.3)), SMALL, noise=StereoNoise())
    truth = {f"{i:06d}": frame.labels for i, frame in enumerate(source)}
    write_folder(source, "drive")
    assert run(["record", "drive", "-o", "drive.mcap"]) == 0
    first, *rest = commands()
    assert run(first) == 0
    images = sorted(path.stem for path in Path("images").glob("*.png"))
    assert images == [f"{i:06d}" for i in range(0, 16, 2)]
    drawn = {name: outlines(mask) for name, mask in truth.items() if mask is not None and name in images}
    export(tmp_path, drawn)
    for command in rest:
        capsys.readouterr()
        assert run(command) == 0, command
        if command[0] == "evaluate" and "masks/" not in command:
            assert "lawn = grass" in capsys.readouterr().err
    found = [json.loads(file.read_text()) for file in sorted(Path().glob("out*/results.json"))]
    assert len(found) == 4
    assert [f["frames"]["evaluated"] for f in found] == [8] * 4
    assert (
        len({json.dumps(f["maps"][f["main"]]["overall"]["cells"]) for f in found}) <= 2
    )  # order of overlaps
    margin = read_margin(Path("out/margin.yaml"))
    assert margin.margin_m > 0
    grown, bare = read_costmap("map/costmap.yaml"), run([*rest[-1][:-2], "-o", "bare/", "--margin", "0"])
    assert bare == 0
    assert (grown.costs == 254).sum() > (read_costmap("bare/costmap.yaml").costs == 254).sum()


def test_drawn_again_masks_are_the_true_ones(tmp_path: Path) -> None:
    """Of the drawings above: inside of their outlines, every tool's export gives the true classes."""
    source = AnalyticSource(garden_scene(1), tuple(lane_poses(1)), SMALL)
    (frame,) = source
    assert frame.labels is not None
    export(tmp_path, {"000000": outlines(frame.labels)})
    said = {"verge": "other", "man": "person"}
    for given in ("annotations.xml", "project.json", "roboflow"):
        mask = read_masks(tmp_path / given, classes=said, guess=True)["000000"]
        judged = mask != 255
        assert judged.mean() > 0.5
        assert (mask == frame.labels)[judged].mean() > 0.97


def test_unknown_words_and_nothing_evaluated_are_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    source = AnalyticSource(garden_scene(1), tuple(lane_poses(2, step_m=0.3)), SMALL)
    write_folder(source, "drive")
    export(tmp_path, {"nobody": [("verge", np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 9.0)]))]})
    words = ["evaluate", "drive", "-o", "out", "--segmenter", "colour", "--masks", "annotations.xml"]
    assert run(words) == 1
    assert "--class 'verge=...'" in capsys.readouterr().err
    assert not Path("out").exists()
    assert run([*words, "--class", "verge=other", "--workers", "1"]) == 1
    told = capsys.readouterr()
    assert "0 of 2 frames evaluated" in told.out
    assert "not one frame could be evaluated" in told.err
    assert run([*words, "--class", "verge"]) == 2
