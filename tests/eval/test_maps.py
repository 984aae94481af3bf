from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swardmap.config import CloudConfig, Config, GeometryConfig, GridConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.eval.maps import (
    cloud_map,
    compare_frame,
    compare_maps,
    frame_map,
    tied_cells,
    true_segmentation,
)
from swardmap.eval.protocols import PROTOCOLS, at_resolution, protocol_configs
from swardmap.eval.tally import MapTally, MissedKind, MissKind, total_of
from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.clouds.cloud_files import read_cloud, write_pcd
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.perception.cloud import crop_range, label_cloud
from swardmap.synth.analytic import AnalyticSource, StereoNoise, garden_scene, lane_poses
from swardmap.types import Frame, Segmentation

SMALL = AnalyticSource().intrinsics.scaled_to(320, 240)


def frames(noise: StereoNoise | None = None, seed: int = 0) -> list[Frame]:
    poses = tuple(lane_poses(3, step_m=0.8))
    return list(AnalyticSource(garden_scene(seed), poses, SMALL, noise=noise, seed=seed))


def pose(frame: Frame) -> Pose:
    assert frame.T_map_camera is not None
    return frame.T_map_camera


@pytest.mark.parametrize("resolution_m", [0.05, 0.1])
def test_true_labels_without_processing_give_the_reference_itself(resolution_m: float) -> None:
    for frame in frames():
        cloud = CloudConfig(consistent_neighbours=0)
        grid = GridConfig(resolution_m=resolution_m, min_points=1, min_grass_points=1)
        config = Config(cloud=cloud, grid=grid)
        config = Config(cloud=cloud, grid=grid)
        found = compare_frame(frame, true_segmentation(frame), pose(frame), config)
        assert np.array_equal(found.reference.classes, found.predicted.classes)
        assert found.tally.misses == {}
        assert found.tally.missed == {}
        assert found.tally.matrix.accuracy == 1
        assert found.tally.obstacles > 3


@pytest.mark.parametrize("noise", [None, StereoNoise()])
def test_under_the_papers_protocol_the_unknown_class_agrees_exactly(noise: StereoNoise | None) -> None:
    rng = np.random.default_rng(0)
    for frame in frames(noise):
        assert frame.labels is not None
        mask = np.where(rng.random(frame.labels.shape) < 0.2, 1, frame.labels).astype(np.uint8)
        found = compare_frame(
            frame, Segmentation(mask, GRASS_OBSTACLE_PERSON), pose(frame), Config(), "paper-own"
        )
        unknown = found.tally.matrix.scores("unknown")
        assert (unknown.recall, unknown.precision, unknown.accuracy) == (1, 1, 1)
        assert found.tally.matrix.obstacle_called_free.count > 0


def test_an_annotated_cloud_gives_the_map_of_its_pixels(tmp_path: Path) -> None:
    """The paper's way for real data: the cloud of a frame, annotated, saved as PCD, read, mapped."""
    (frame, *_) = frames(StereoNoise())
    reference = compare_frame(frame, true_segmentation(frame), pose(frame), Config()).reference
    depth_m = crop_range(frame.depth_m, Config().cloud.min_range_m, Config().cloud.max_range_m)
    write_pcd(label_cloud(frame, true_segmentation(frame), depth_m), tmp_path / "frame.pcd")
    cloud = read_cloud(tmp_path / "frame.pcd", GRASS_OBSTACLE_PERSON)
    again = cloud_map(cloud, pose(frame), Config(), reference.spec)
    assert np.array_equal(again.classes, reference.classes)


def test_range_bands_and_ties_of_a_planted_miss() -> None:
    spec = GridSpec(0.5, 40, 10)
    reference = np.full(spec.shape, MapClass.GRASS, np.uint8)
    reference[2, 2:20] = MapClass.OBSTACLE
    predicted = reference.copy()
    predicted[2, [2, 15]] = MapClass.GRASS  # centres at x = 1.25 and 7.75
    found = compare_maps(
        OccupancyGrid(spec, reference), OccupancyGrid(spec, predicted), camera_xy_m=(0.0, 1.25)
    )
    assert found.tally.misses == {
        MissKind(False, False, True, 0, 1): 1,
        MissKind(False, False, True, 3, 1): 1,
    }
    assert tied_cells(found).tolist() == [[[2, 2], [3, 2]], [[15, 2], [14, 2]]]
    assert found.tally.distances(band=3).counts == {1: 1}
    assert found.tally.distances(person=True).count == 0


def test_a_frame_without_any_hit_is_counted_and_has_no_distance() -> None:
    spec = GridSpec(0.1, 8, 8)
    reference = np.full(spec.shape, MapClass.GRASS, np.uint8)
    reference[1:3, 1:3] = MapClass.PERSON
    found = compare_maps(
        OccupancyGrid(spec, reference), OccupancyGrid(spec, np.full(spec.shape, MapClass.GRASS, np.uint8))
    )
    assert found.tally.frames_without_hit == 1
    assert found.tally.misses_without_hit == 4
    assert found.tally.distances().summary().mean_m is None
    assert found.tally.missed == {MissedKind(True, 4, 4): 1}
    assert found.tally.matrix.person_called_free.value == 1
    assert len(tied_cells(found)) == 0


def test_an_obstacle_that_was_not_seen_is_missed_but_not_called_free() -> None:
    spec = GridSpec(0.1, 8, 8)
    reference = np.full(spec.shape, MapClass.UNKNOWN, np.uint8)
    reference[3, 3] = MapClass.OBSTACLE
    nothing = OccupancyGrid.unknown(spec)
    tally = compare_maps(OccupancyGrid(spec, reference), nothing).tally
    assert (tally.missed_obstacles, tally.missed_called_free, tally.frames_with_misses) == (1, 0, 0)
    assert tally.matrix.obstacle_not_seen.value == 1
    empty = compare_maps(nothing, nothing).tally
    assert (empty.obstacles, empty.frames_with_misses, dict(empty.misses)) == (0, 0, {})


@given(st.lists(st.integers(0, 2**32), min_size=1, max_size=6), st.randoms(use_true_random=False))
@settings(deadline=None, max_examples=30)
def test_tallies_add_up_in_any_order_and_survive_a_file(seeds: list[int], random: object) -> None:
    spec = GridSpec(0.05, 12, 9)
    tallies = []
    for seed in seeds:
        maps = np.random.default_rng(seed).integers(0, 4, (2, *spec.shape)).astype(np.uint8)
        tallies.append(compare_maps(OccupancyGrid(spec, maps[0]), OccupancyGrid(spec, maps[1])).tally)
    whole = total_of(tallies, 0.05)
    random.shuffle(tallies)  # type: ignore[attr-defined]
    assert sum(tallies, MapTally(0.05)) == whole
    assert total_of(tallies[::-1], 0.05) == whole
    assert MapTally.from_dict(whole.to_dict(), 0.05) == whole
    assert whole.frames == len(seeds)
    assert sum(whole.misses.values()) == whole.matrix.obstacle_called_free.count


def test_what_does_not_fit_is_refused() -> None:
    spec = GridSpec(0.05, 12, 9)
    with pytest.raises(InvalidValueError, match="one grid"):
        compare_maps(OccupancyGrid.unknown(spec), OccupancyGrid.unknown(replace(spec, width=11)))
    with pytest.raises(InvalidValueError, match="cannot add"):
        _ = MapTally(0.05) + MapTally(0.1)
    with pytest.raises(InvalidValueError, match="protocol"):
        protocol_configs(Config(), "mine")
    (frame, *_) = frames()
    with pytest.raises(InputError, match="true labels"):
        compare_frame(
            replace(frame, labels=None, label_set=None), true_segmentation(frame), pose(frame), Config()
        )
    assert frame_map(frame, true_segmentation(frame), pose(frame), at_resolution(Config(), 0.1)).count(
        MapClass.GRASS
    )


def test_geometry_is_in_the_predicted_map_and_never_in_the_reference() -> None:
    on = replace(Config(), geometry=GeometryConfig(enabled=True))
    for protocol in PROTOCOLS[1:]:
        of_reference, of_predicted = protocol_configs(on, protocol)
        assert not of_reference.geometry.enabled
        assert of_predicted.geometry.enabled == (protocol == "paper")  # the paper's own method has none
