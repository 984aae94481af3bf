"""Frames of an evaluation: read as the robot reads them, with references made of all that the sensor saw."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swardmap.config import Config, config_from_dict
from swardmap.eval import dataset as dataset_module
from swardmap.eval.dataset import DatasetSpec, read_frames
from swardmap.eval.frame import compare_again, evaluate_frame
from swardmap.eval.frame_maps import FrameMaps
from swardmap.eval.maps import spec_of
from swardmap.eval.run import make_plan
from swardmap.eval.things import find_things
from swardmap.geometry import Intrinsics
from swardmap.io import open_source
from swardmap.io.annotations.mask_folder import write_masks
from swardmap.io.annotations.masks import Masks
from swardmap.io.bags import ros_fields as rf
from swardmap.labels import GRASS, GRASS_OBSTACLE_PERSON, OTHER
from swardmap.models.oracle import open_segmenter
from swardmap.types import Frame
from tests import bags
from tests.lawn_bags import CAMERA, Lawn

COARSE = Intrinsics(80, 60, 65.0, 65.0, 39.25, 29.25)
"""Of the depth sensor: half the pixels of the colour image, so that depth is rendered into that."""
WIRE = 20
"""Column of depth that shows a wire a metre away, one pixel wide: the filter takes it for flying pixels."""


@pytest.fixture
def spec(tmp_path: Path) -> DatasetSpec:
    """A drive with unaligned depth and a wire, and masks that call the wire an obstacle."""

    def depth(image: Any, stamp: int, frame: str) -> Any:
        image = image.copy()
        image[10:40, WIRE] = 1000
        return rf.image_fields(image, stamp, frame)

    lawn = Lawn(camera=CAMERA, depth_camera=COARSE, frames=2, depth=depth)
    path = bags.write_bag(tmp_path, "mcap", lawn.events())
    masks = {}
    for frame in open_source(path):
        green = frame.rgb[..., 1].astype(int) - frame.rgb[..., 2] > 50
        masks[frame.name] = np.where(green, GRASS.id, OTHER.id).astype(np.uint8)
        masks[frame.name][20:80, 2 * WIRE - 1 : 2 * WIRE + 3] = OTHER.id
    readers = {name: partial(masks.__getitem__, name) for name in masks}
    write_masks(Masks(GRASS_OBSTACLE_PERSON, readers), tmp_path / "masks")
    return DatasetSpec(str(path), masks=str(tmp_path / "masks"))


def shows_wire(frame: Frame | None) -> bool:
    assert frame is not None
    return bool((np.abs(frame.depth_m[30:70, 2 * WIRE] - 1) < 0.05).any())


def test_depth_is_filtered_as_the_robot_is_told_to(spec: DatasetSpec) -> None:
    """The filter before alignment is that of `cloud`, as `swardmap map` has it."""
    for neighbours, wire in ((0, True), (1, True), (3, False), (8, False)):
        config = config_from_dict({"cloud": {"consistent_neighbours": neighbours}})
        (robot, _), (numbered, _) = open_source(spec.location, config), read_frames(spec, 0, 2, config)
        assert numbered.frame is not None
        np.testing.assert_array_equal(numbered.frame.depth, robot.depth)
        assert numbered.frame.depth_filtered == robot.depth_filtered == (neighbours > 0)
        assert shows_wire(numbered.frame) == wire
        assert (numbered.best is None) == (neighbours == 0)
        assert numbered.best is None or shows_wire(numbered.best)


def test_what_the_filter_takes_stays_in_the_truth(spec: DatasetSpec) -> None:
    config = config_from_dict({"segmenter": {"name": "truth"}})
    plan = make_plan(spec, config, resolutions_m=(0.1,), protocols=("dense",))
    (numbered, second) = read_frames(spec, 0, 2, config)
    frame = numbered.frame
    assert frame is not None
    assert second.unfiltered is not None
    assert second.unfiltered.name == second.frame.name  # type: ignore[union-attr]
    segmenter = open_segmenter(config.segmenter, frame.label_set)
    _, found = compare_again(plan, frame, numbered.best, segmenter, numbered.truth)
    _, as_filtered = compare_again(plan, frame, None, segmenter, numbered.truth)
    wire = found.reference.is_obstacle & ~as_filtered.reference.is_obstacle
    assert wire.any()
    np.testing.assert_array_equal(found.predicted.classes, as_filtered.predicted.classes)  # it is the robot's
    record = evaluate_frame(plan, numbered, segmenter)
    assert record["maps"]["dense@0.1"] == found.tally.to_dict()
    budget = record["budget"]  # the filter is of the processing, and is no error of depth
    assert budget["truth"] != budget["+ processing"]
    assert budget["+ mask"] == record["maps"]["dense@0.1"]
    assert "+ depth" not in budget


def test_flying_pixels_of_the_unfiltered_truth_are_no_things(spec: DatasetSpec) -> None:
    """Rendered into a finer image they agree with their own copies: the filter before that tells them."""
    config = config_from_dict({"segmenter": {"name": "truth"}})
    (numbered, _) = read_frames(spec, 0, 2, config)
    frame, best = numbered.frame, numbered.best
    assert frame is not None
    assert best is not None
    assert frame.T_map_camera is not None
    assert numbered.filtered is frame
    pose, grid = frame.T_map_camera, spec_of(frame, frame.T_map_camera, config)
    pixels = FrameMaps().pixels(best, pose, config)
    cells = pixels.cells(grid)
    things = [
        find_things(best, pixels, cells, grid, config, None, filtered).things
        for filtered in (None, numbered.filtered)
    ]
    of_frame = FrameMaps().pixels(frame, pose, config)
    known = find_things(frame, of_frame, of_frame.cells(grid), grid, config, None).things
    assert len(things[0]) > len(things[1]) == len(known) == 1  # the box


def test_a_stream_is_read_beside_itself_unfiltered(
    spec: DatasetSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    def endless(location: str, config: Config) -> Any:
        return replace(open_source(location, config), frame_count=None)  # type: ignore[type-var]

    listed = list(read_frames(spec, 0, 2))
    monkeypatch.setattr(dataset_module, "open_source", endless)
    for known, streamed in zip(listed, read_frames(spec, 0, 2), strict=True):
        assert streamed.unfiltered is not None
        assert known.unfiltered is not None
        np.testing.assert_array_equal(streamed.unfiltered.depth, known.unfiltered.depth)
    (last,) = read_frames(spec, 1, 2)
    assert last.unfiltered is not None
    np.testing.assert_array_equal(last.unfiltered.depth, listed[1].unfiltered.depth)  # type: ignore[union-attr]
