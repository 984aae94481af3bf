"""The census against counts by hand."""

import json
from pathlib import Path

import numpy as np
import pytest

from swardmap.errors import InputError
from swardmap.labels import PERSON
from swardmap.synth.census import EDGES_M, census, census_text, frame_facts, read_facts
from swardmap.synth.model import Model, Thing, View
from swardmap.synth.shapes import box

SHAPE = Model("shape", (box((1, 1, 1)),))
THINGS = (
    Thing(SHAPE, "tree"),
    Thing(SHAPE, "person", label=PERSON, pose="lying"),
    Thing(SHAPE, "tree"),
    Thing(SHAPE, "dog", pose="sitting"),
)


def view() -> View:
    labels = np.ones((10, 10), np.uint8)
    depth = np.full((10, 10), 2.5, np.float32)
    which = np.zeros((10, 10), np.uint16)
    labels[0], depth[0] = 0, 0.0  # sky
    labels[1:4], depth[1:4], which[1:4] = 2, 5.0, 2
    labels[4], depth[4], which[4] = 0, 40.0, 1
    labels[5, :4], depth[5, :4], which[5, :4] = 0, 0.5, 3
    depth[1, 0] = 4.5
    return View(np.zeros((10, 10, 3), np.float32), depth, labels, which)


def test_one_frame_is_counted_by_hand() -> None:
    facts = frame_facts(view(), THINGS)
    assert facts["pixels"] == {"other": 24, "grass": 46, "person": 30}
    assert facts["kinds"] == {"tree": 14, "person": 30}
    assert facts["poses"] == {"lying": 30}
    assert facts["nearest_person_m"] == 4.5
    at = {name: dict(zip(EDGES_M, counts, strict=True)) for name, counts in facts["distances"].items()}
    assert at["grass"][2.0] == 46
    assert at["person"][4.0] == 30
    assert at["other"] == {**dict.fromkeys(EDGES_M, 0), 0.0: 4, 30.0: 10}, "sky has no distance"


def test_sums_are_over_frames_and_by_light(tmp_path: Path) -> None:
    facts = frame_facts(view(), THINGS)
    nothing = np.zeros((10, 10))
    sky = View(np.zeros((10, 10, 3), np.float32), nothing.astype(np.float32), nothing.astype(np.uint8),
               nothing.astype(np.uint16))  # fmt: skip
    empty = frame_facts(sky, THINGS)
    for light, frames in (("clear", [facts, facts]), ("sunset", [empty])):
        folder = tmp_path / "0000" / light
        folder.mkdir(parents=True)
        (folder / "frames.jsonl").write_text("".join(json.dumps(f) + "\n" for f in frames))
    found = census(read_facts(tmp_path))
    assert found["all"]["frames"] == 3
    assert found["all"]["frames_with_person"] == pytest.approx(2 / 3)
    assert found["all"]["pixels"]["person"] == pytest.approx(60 / 300)
    assert found["all"]["kinds"] == {"person": 2}, "14 pixels of trees are too few to be seen"
    assert found["all"]["poses"] == {"lying": 2}
    assert found["illuminations"]["sunset"]["frames_with_person"] == 0
    assert found["illuminations"]["clear"]["distances"]["person"][EDGES_M.index(4.0)] == 1.0
    text = census_text(found)
    assert "3 frames, 67 % of them with a person" in text
    assert "lying 2" in text


def test_a_folder_without_facts_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a folder that `swardmap synth` wrote"):
        list(read_facts(tmp_path))
    (tmp_path / "frames.jsonl").write_text("{broken")
    with pytest.raises(InputError, match=r"frames\.jsonl: expected JSON"):
        list(read_facts(tmp_path))
