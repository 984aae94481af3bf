"""Clouds against the cloud that the map is made of, and against the depth image."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from swardmap.config import CloudConfig, Config, config_from_dict
from swardmap.geometry import Intrinsics, Pose, deproject
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.bags.ros_fields import rosbags_message
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.models.oracle import open_segmenter
from swardmap.pipeline import ObstacleMapper, StepResult
from swardmap.ros.clouds import (
    ABOVE_GROUND_M,
    CLEARS_BELOW_M,
    FramePoints,
    cloud_fields,
    frame_points,
    ground_fields,
    height_row,
    marked_by_depth_m,
    obstacle_cells_fields,
    organised_cloud_fields,
)
from swardmap.ros.near_frame import near_frame
from swardmap.synth.analytic import StereoNoise, garden_scene, lane_poses, render, with_sensor_noise
from swardmap.types import Frame, Segmentation

STORE = get_typestore(Stores.ROS2_JAZZY)
CLOUD = "sensor_msgs/msg/PointCloud2"
AT = 5, "optical"
SMALL = Intrinsics(80, 60, 57.5, 57.5, 39.5, 29.5)


def garden_step(config: Config) -> StepResult:
    frame = render(garden_scene(0), SMALL, lane_poses(1)[0])
    return ObstacleMapper(open_segmenter(config.segmenter, frame.label_set), config).step(frame)


def points_of(step: StepResult, config: Config) -> FramePoints:
    return frame_points(step.frame, step.segmentation, height_row(step), config.cloud)


Seen = tuple[Frame, Segmentation, NDArray[np.float32], CloudConfig]


def seen_in(step: StepResult, config: Config) -> Seen:
    return step.frame, step.segmentation, height_row(step), config.cloud


def row_of(T_map_camera: Pose | None) -> NDArray[np.float32]:
    """Heights above the map's z = 0."""
    assert T_map_camera is not None
    row: NDArray[np.float32] = T_map_camera.matrix[2].astype(np.float32)
    return row


def read(fields: dict[str, Any]) -> tuple[Any, Any, Any]:
    """xyz and labels by the offsets that the message itself gives, after a way through CDR."""
    data = STORE.serialize_cdr(rosbags_message(STORE, CLOUD, fields), CLOUD)
    message: Any = STORE.deserialize_cdr(data, CLOUD)
    count = message.width * message.height
    assert message.row_step == message.width * message.point_step
    assert len(message.data) == message.row_step * message.height
    rows = message.data.reshape(count, message.point_step)
    columns = {
        f.name: np.ascontiguousarray(rows[:, f.offset : f.offset + 4]).view(
            "<u4" if f.datatype == 6 else "<f4"
        )
        for f in message.fields
    }
    xyz = np.concatenate([columns[axis] for axis in "xyz"], axis=1)
    return message, xyz, columns["label"][:, 0]


def test_the_cloud_is_the_one_the_map_is_made_of() -> None:
    config = Config()
    step = garden_step(config)
    message, xyz, labels = read(cloud_fields(*seen_in(step, config), AT))
    assert (message.height, message.header.frame_id, message.is_dense) == (1, "optical", True)
    expected = step.cloud(config)  # in the map frame, by the pipeline's own functions
    assert len(xyz) == len(expected) > 1000
    T = Pose(step.T_map_camera.parent, "optical", step.T_map_camera.matrix)
    np.testing.assert_allclose(T.apply(xyz), expected.xyz, atol=1e-5)
    np.testing.assert_array_equal(labels, expected.labels)


def test_an_organised_cloud_has_one_point_a_pixel() -> None:
    config = Config()
    step = garden_step(config)
    message, xyz, labels = read(organised_cloud_fields(points_of(step, config), 5, "optical"))
    assert (message.height, message.width, message.is_dense) == (60, 80, False)
    seen = np.isfinite(xyz).all(axis=1)
    of_pixels = deproject(step.frame.depth_m, SMALL).reshape(-1, 3)
    np.testing.assert_array_equal(xyz[seen], of_pixels[seen])
    assert (labels[~seen] == 255).all()
    np.testing.assert_array_equal(labels[seen], step.segmentation.labels.reshape(-1)[seen])
    assert seen.sum() == len(step.cloud(config))


def test_obstacle_points_fall_into_the_obstacle_cells_and_into_all_of_them() -> None:
    config = config_from_dict({"grid": {"min_points": 1}})
    step = garden_step(config)
    _, xyz, _ = read(cloud_fields(*seen_in(step, config), AT, MapClass.OBSTACLE))
    in_map = Pose("map", "optical", step.T_map_camera.matrix).apply(xyz)
    cells = step.seen.spec.cell_of(in_map[:, :2])
    hit = np.zeros(step.seen.spec.shape, bool)
    hit[cells[:, 1], cells[:, 0]] = True
    different = hit != step.seen.is_obstacle
    assert step.seen.is_obstacle.sum() > 50
    assert different.sum() <= 2  # a point on the very border of a cell, by float32 in another order


def test_what_depth_alone_marks_is_in_the_obstacle_cloud(
    flat_lawn: tuple[Frame, Segmentation],
) -> None:
    config = config_from_dict({"geometry": {"min_points": 1}})
    frame = render(garden_scene(0), SMALL, lane_poses(1)[0])
    blind = replace(frame, labels=np.ones_like(frame.labels))  # the network calls everything grass

    step = ObstacleMapper(open_segmenter(config.segmenter, frame.label_set), config).step(blind)
    assert step.observation.by_geometry is not None
    assert step.observation.by_geometry.sum() > 20
    fields = cloud_fields(*seen_in(step, config), AT, MapClass.OBSTACLE, marked_by_depth_m(step))
    _, xyz, labels = read(fields)
    assert len(xyz) == step.observation.by_geometry.sum()
    in_map = Pose("map", "optical", step.T_map_camera.matrix).apply(xyz)
    cells = step.seen.spec.cell_of(in_map[:, :2])
    assert step.observation.by_geometry[cells[:, 1], cells[:, 0]].all()
    over_ground = in_map[:, 2] - step.observation.ground_m[cells[:, 1], cells[:, 0]]
    np.testing.assert_allclose(over_ground, ABOVE_GROUND_M, atol=1e-4)
    assert (in_map[:, 2] < config.cloud.max_height_m).all()
    table = step.segmentation.label_set.map_class_table
    assert (table[labels] == MapClass.OBSTACLE).all()


limits = st.fixed_dictionaries(
    {
        "consistent_neighbours": st.integers(0, 8),
        "max_range_m": st.floats(0.5, 12.0),
        "min_height_m": st.floats(-0.5, 0.2),
        "max_height_m": st.floats(0.3, 2.0),
        "consistency_relative": st.floats(0.0, 0.1),
    }
)


@given(
    limits,
    st.sampled_from([MapClass.UNKNOWN, MapClass.OBSTACLE]),
    st.integers(0, 5),
    st.booleans(),
    st.integers(1, 4),
)
def test_the_compiled_cloud_is_its_numpy_twin_bit_for_bit(
    settings: dict[str, Any], lowest: MapClass, seed: int, metres: bool, stride: int
) -> None:
    rng = np.random.default_rng(seed)
    frame = with_sensor_noise(render(garden_scene(0), SMALL, lane_poses(6)[seed]), rng, StereoNoise())
    if metres:
        frame = replace(frame, depth=frame.depth_m, depth_unit_m=1.0)
    labels = rng.choice(np.array([0, 1, 2, 255], np.uint8), (30, 33))  # of another size, with void
    segmentation = Segmentation(labels, GRASS_OBSTACLE_PERSON)
    config = config_from_dict({"cloud": settings}).cloud
    seen = frame, segmentation, row_of(frame.T_map_camera), config
    twin = frame_points(*seen)
    wanted = twin.kept & (GRASS_OBSTACLE_PERSON.map_class_table[twin.labels] >= lowest)
    taken = np.zeros((SMALL.height, SMALL.width), bool)
    taken[::stride, ::stride] = True
    wanted &= taken.reshape(-1)
    _, xyz, found = read(cloud_fields(*seen, AT, lowest, stride=stride))
    np.testing.assert_array_equal(xyz, twin.xyz[wanted])
    np.testing.assert_array_equal(found, twin.labels[wanted])


def test_without_geometry_nothing_is_added() -> None:
    assert marked_by_depth_m(garden_step(Config())).shape == (0, 3)


def test_a_frame_without_a_reading_gives_empty_clouds(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, segmentation = flat_lawn
    empty = replace(frame, depth=np.zeros_like(frame.depth))
    for lowest in (MapClass.UNKNOWN, MapClass.OBSTACLE):
        fields = cloud_fields(empty, segmentation, row_of(frame.T_map_camera), Config().cloud, AT, lowest)
        message, xyz, _ = read(fields)
        assert message.width == len(xyz) == 0


@pytest.mark.parametrize("organised", [False, True])
def test_without_geometry_heights_are_those_of_the_map(
    flat_lawn: tuple[Frame, Segmentation], organised: bool
) -> None:
    frame, segmentation = flat_lawn
    config = config_from_dict({"cloud": {"min_height_m": 0.5}})
    seen = frame, segmentation, row_of(frame.T_map_camera), config.cloud
    fields = organised_cloud_fields(frame_points(*seen), *AT) if organised else cloud_fields(*seen, AT)
    _, xyz, _ = read(fields)
    assert not np.isfinite(xyz).any()  # the lawn lies at z = 0


def on_a_hill(T_map_camera: Pose, slope_deg: float, z_m: float) -> Pose:
    """The same view where the field slopes down along x, far above the datum."""
    slope = np.deg2rad(slope_deg)
    T_hill_map = np.eye(4)
    T_hill_map[:3, :3] = [[np.cos(slope), 0, np.sin(slope)], [0, 1, 0], [-np.sin(slope), 0, np.cos(slope)]]
    T_hill_map[2, 3] = z_m
    return Pose("map", T_map_camera.child, T_hill_map @ T_map_camera.matrix)


@pytest.mark.parametrize(("slope_deg", "z_m"), [(10.0, 0.0), (-12.0, 0.0), (0.0, 150.0), (0.0, -3.0)])
def test_on_any_ground_the_clouds_are_those_of_level_ground(slope_deg: float, z_m: float) -> None:
    """Heights above z = 0 of the map would cut obstacles off and leave nothing to clear by."""
    config = config_from_dict({"geometry": {"enabled": True}})
    frame = render(garden_scene(0), SMALL, lane_poses(40, step_m=0.25)[30])  # some metres from the origin
    assert frame.T_map_camera is not None
    tilted = replace(frame, T_map_camera=on_a_hill(frame.T_map_camera, slope_deg, z_m))
    found = []
    for each in (frame, tilted):
        step = ObstacleMapper(open_segmenter(config.segmenter, frame.label_set), config).step(each)
        seen = seen_in(step, config)
        clouds = (cloud_fields(*seen, AT, MapClass.OBSTACLE), ground_fields(step, config.cloud, AT))
        found.append([len(read(fields)[1]) for fields in clouds])
    (obstacles, lawn), (obstacles_on_hill, lawn_on_hill) = found
    assert obstacles > 20
    assert lawn > 500
    assert obstacles_on_hill == pytest.approx(obstacles, rel=0.02, abs=2)
    assert lawn_on_hill == pytest.approx(lawn, rel=0.02)


def test_only_lawn_near_the_ground_clears() -> None:
    config = config_from_dict({"geometry": {"enabled": True}})
    step = garden_step(config)
    _, xyz, labels = read(ground_fields(step, config.cloud, AT))
    assert (step.segmentation.label_set.map_class_table[labels] == MapClass.GRASS).all()
    a, b, c, d = height_row(step)
    heights = a * xyz[:, 0] + b * xyz[:, 1] + c * xyz[:, 2] + d
    assert len(heights) > 500
    assert heights.max() <= CLEARS_BELOW_M + 1e-5
    assert heights.min() >= config.cloud.min_height_m - 1e-5
    groundless = replace(step, observation=replace(step.observation, ground=None))
    _, none, _ = read(ground_fields(groundless, config.cloud, AT))
    assert len(none) == 0  # where no ground is known nothing is near it


@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize("hazard", [0.0, 0.45])
def test_only_pixels_of_cells_that_the_map_clears_are_lawn_that_clears(hazard: float, stride: int) -> None:
    """A doubtful pixel never clears a cell: of the map, nor of Nav2's obstacle layer."""
    config = config_from_dict({"cloud": {"consistent_neighbours": 0}})
    frame = render(garden_scene(0), SMALL, lane_poses(1)[0])
    assert frame.labels is not None
    doubtful = np.zeros(frame.labels.shape, np.uint8)
    doubtful[:, 40:] = round(255 * hazard)  # the right half
    mask = Segmentation(np.ones_like(frame.labels), GRASS_OBSTACLE_PERSON, None, doubtful)
    step = ObstacleMapper(open_segmenter(config.segmenter, frame.label_set), config).integrate(frame, mask)
    by_depth = step.observation.by_geometry
    assert by_depth is not None
    assert by_depth.any(), "some of what is called grass stands above the ground"
    _, xyz, _ = read(ground_fields(step, config.cloud, AT, stride))
    in_map = Pose("map", "optical", step.T_map_camera.matrix).apply(xyz)
    spec = step.seen.spec
    cells = spec.cell_of(in_map[:, :2])
    called = step.seen.classes[cells[:, 1], cells[:, 0]]
    assert (called != MapClass.GRASS).mean() < 0.002  # at borders of cells, by float32 in another order
    columns = np.rint(57.5 * xyz[:, 0] / xyz[:, 2] + 39.5)
    assert (columns < 40).sum() > 500 / stride**2
    assert (columns >= 44).any() == (hazard == 0.0)  # a cell of the border has pixels of both halves
    cleared = np.zeros(spec.shape, bool)
    cleared[cells[:, 1], cells[:, 0]] = True
    if stride == 1:  # and nothing is left out that the map clears, up to 0.15 m
        wanted = step.seen.classes == MapClass.GRASS
        assert (wanted & ~cleared).sum() <= 0.02 * wanted.sum()


def test_obstacle_cells_lie_at_the_height_of_the_robot() -> None:
    """Nav2's collision monitor drops what is farther than its limits above or below the base."""
    spec = GridSpec(0.5, 6, 4, (-1.0, 2.0), "map")
    classes = np.full(spec.shape, MapClass.OBSTACLE, np.uint8)
    fields = obstacle_cells_fields(OccupancyGrid(spec, classes), (0.0, 2.5), 9.0, 312.5)
    assert (read(fields)[1][:, 2] == 312.5).all()


def test_obstacle_cells_are_the_obstacles_of_the_map_that_are_near() -> None:
    spec = GridSpec(0.5, 6, 4, (-1.0, 2.0), "map")
    classes = np.zeros(spec.shape, np.uint8)
    classes[0, 0], classes[1, 2], classes[3, 5], classes[2, 2] = 2, 3, 2, 1
    fields = obstacle_cells_fields(OccupancyGrid(spec, classes, 7_000_000_001), (0.0, 2.5), 1.5)
    _, xyz, labels = read(fields)
    # centres by hand: cell (0, 0) at (-0.75, 2.25), (2, 1) at (0.25, 2.75); (5, 3) at (1.75, 3.75) is too far
    np.testing.assert_allclose(xyz, [[-0.75, 2.25, 0.0], [0.25, 2.75, 0.0]])
    assert labels.tolist() == [MapClass.OBSTACLE, MapClass.PERSON]
    assert fields["header"]["frame_id"] == "map"
    assert fields["header"]["stamp"] == {"sec": 7, "nanosec": 1}
    empty = obstacle_cells_fields(OccupancyGrid.unknown(spec), (0.0, 2.5), 1.5)
    assert len(read(empty)[1]) == 0


@given(st.floats(-9e6, 9e6), st.floats(-9e6, 9e6), st.integers(0, 5))
def test_obstacle_cells_are_exact_to_a_millimetre_wherever_the_map_lies(
    x_m: float, y_m: float, seed: int
) -> None:
    """At a UTM northing of 5e6 m steps of float32 are half a metre."""
    lattice = np.floor(np.array([x_m, y_m]) / 0.05) * 0.05
    spec = GridSpec(0.05, 40, 30, (float(lattice[0]), float(lattice[1])), "map")
    classes = np.random.default_rng(seed).integers(0, 4, spec.shape).astype(np.uint8)
    grid, around_m = OccupancyGrid(spec, classes), (x_m + 1.0, y_m + 0.7)
    message, xyz, _ = read(obstacle_cells_fields(grid, around_m, 10.0, 80.0))
    T_map_near = near_frame("map", around_m)
    found = xyz.astype(np.float64)
    if T_map_near is None:
        assert message.header.frame_id == "map"
    else:
        assert message.header.frame_id == T_map_near.child
        found = T_map_near.apply(found)
    rows, columns = np.nonzero(grid.is_obstacle)
    wanted = spec.center_of(np.stack([columns, rows], axis=-1))
    assert np.abs(found[:, :2] - wanted).max() < 1e-3
    assert (xyz[:, 2] == 80.0).all()


def test_near_the_origin_obstacle_cells_stay_in_the_map_frame() -> None:
    assert near_frame("map", (4_999.0, -4_999.0)) is None
    east, north = near_frame("map", (-12_000.0, 0.0)), near_frame("map", (0.0, 5_001.0))
    assert east is not None
    assert north is not None
    assert (east.parent, east.child, east.position_m.tolist()) == ("map", "map_e-10000_n0", [-10_000, 0, 0])
    assert north.child == "map_e0_n10000"
