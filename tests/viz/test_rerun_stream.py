"""What goes to Rerun, read back by Rerun's own reader: value for value what the pipeline gave."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from swardmap.config import config_from_dict
from swardmap.errors import MissingExtraError, OutputError
from swardmap.geometry import Intrinsics
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.pipeline import ObstacleMapper, StepResult
from swardmap.synth.analytic import AnalyticSource, StereoNoise, garden_scene, lane_poses
from swardmap.types import Frame, Segmentation
from swardmap.viz.maps import UNKNOWN_COLOR, draw_classes, tint_costs
from swardmap.viz.rerun_sink import RerunSink, load_rerun, rerun_sink
from swardmap.viz.rerun_stream import MAP_EVERY, RerunStream, layout, view_of
from tests.rrd import Rows, image, numbers, read

SMALL = Intrinsics(80, 60, 57.5, 57.5, 39.5, 29.5)
CONFIG = config_from_dict({"costmap": {"margin_m": 0.2}, "grid": {"mode": "evidence"}})
START_NS = 1_700_000_000_000_000_000


class Half:
    """True masks of half the size, with a confidence."""

    name, label_set = "half", GRASS_OBSTACLE_PERSON

    def __call__(self, frame: Frame) -> Segmentation:
        assert frame.labels is not None
        sure = np.linspace(0, 1, 40 * 30, dtype=np.float32).reshape(30, 40)
        return Segmentation(frame.labels[::2, ::2].copy(), GRASS_OBSTACLE_PERSON, sure)


def frames(count: int = 7) -> Iterator[Frame]:
    poses = tuple(lane_poses(count, step_m=0.3))
    for frame in AnalyticSource(garden_scene(0), poses, SMALL, noise=StereoNoise()):
        yield replace(frame, stamp_ns=START_NS + frame.stamp_ns)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[StepResult], ObstacleMapper, Rows]:
    path = tmp_path_factory.mktemp("rerun") / "a.rrd"
    mapper = ObstacleMapper(Half(), CONFIG)
    steps = []
    with rerun_sink(path, layout=layout()) as sink:
        stream = RerunStream(sink, CONFIG)
        for frame in frames():
            steps.append(mapper.step(frame))
            stream.add(steps[-1], mapper, read_ms=2.5)
        stream.finish(mapper)
    return steps, mapper, read(path)


def test_images_are_what_they_were(run: tuple[list[StepResult], ObstacleMapper, Rows]) -> None:
    steps, _, rows = run
    for i, step in enumerate(steps):
        camera = "/world/camera"
        np.testing.assert_array_equal(image(rows, f"{camera}/photo", "Image", i), step.frame.rgb)
        np.testing.assert_array_equal(image(rows, f"{camera}/depth", "DepthImage", i), step.frame.depth)
        mask = step.segmentation.resized_to(60, 80)
        np.testing.assert_array_equal(image(rows, f"{camera}/mask", "SegmentationImage", i), mask.labels)
        sure = image(rows, f"{camera}/confidence", "Image", i) / 255
        assert mask.confidence is not None
        np.testing.assert_allclose(sure, mask.confidence, atol=0.5 / 255 + 1e-6)
        assert numbers(rows[f"{camera}/depth"]["DepthImage:meter"][i]).tolist() == [1000.0]
        assert rows[camera]["stamp"][i] == step.frame.stamp_ns


def test_camera_and_cloud_are_where_they_were(run: tuple[list[StepResult], ObstacleMapper, Rows]) -> None:
    steps, _, rows = run
    for i, step in enumerate(steps):
        found = rows["/world/camera"]
        translation, matrix = (numbers(found[f"Transform3D:{k}"][i]) for k in ("translation", "mat3x3"))
        np.testing.assert_allclose(translation, step.T_map_camera.position_m, atol=1e-6)
        turn = matrix.reshape(3, 3).T  # column by column
        np.testing.assert_allclose(turn, step.T_map_camera.matrix[:3, :3], atol=1e-6)
        lens = numbers(found["Pinhole:image_from_camera"][i]).reshape(3, 3).T
        np.testing.assert_allclose(lens, SMALL.matrix, atol=1e-5)
        cloud = step.cloud(CONFIG)
        positions = numbers(rows["/world/cloud"]["Points3D:positions"][i]).reshape(-1, 3)
        np.testing.assert_array_equal(positions, cloud.xyz)
        np.testing.assert_array_equal(numbers(rows["/world/cloud"]["Points3D:class_ids"][i]), cloud.labels)


def test_the_last_map_is_the_map_and_its_costs(run: tuple[list[StepResult], ObstacleMapper, Rows]) -> None:
    steps, mapper, rows = run
    last, grid, costmap = len(steps) - 1, mapper.map, mapper.costmap()
    assert grid is not None
    assert costmap is not None
    classes = image(rows, "/map/classes", "SegmentationImage", last)[::-1]
    np.testing.assert_array_equal(classes, grid.classes)
    assert numbers(rows["/map/classes"]["origin_m"][last]).tolist() == list(grid.spec.origin_m)
    assert numbers(rows["/map/classes"]["resolution_m"][last]).tolist() == [grid.spec.resolution_m]
    np.testing.assert_array_equal(image(rows, "/map/costs", "SegmentationImage", last)[::-1], costmap.costs)
    assert sorted(rows["/map/costs"]["SegmentationImage:buffer"]) == [*range(0, last, MAP_EVERY), last]


def test_the_map_lies_on_the_ground_where_its_cells_are(
    run: tuple[list[StepResult], ObstacleMapper, Rows],
) -> None:
    steps, mapper, rows = run
    last, grid, costmap = len(steps) - 1, mapper.map, mapper.costmap()
    assert grid is not None
    assert costmap is not None
    found = {key: value[last] for key, value in rows["/world/map"].items()}
    form = found["GridMap:format"].as_py()[0]
    picture = numbers(found["GridMap:data"]).reshape(form["height"], form["width"], 4)
    x, y, z = numbers(found["GridMap:translation"])
    edge = float(numbers(found["GridMap:cell_size"])[0])
    assert z == 0
    iy, ix = np.nonzero(grid.classes)
    places = grid.spec.center_of(np.stack((ix, iy), axis=-1))
    column, row = (np.floor((places - [x, y]) / edge)).astype(int).T  # from the lower left corner, upwards
    pixels = picture[form["height"] - 1 - row, column]
    assert (pixels[:, 3] == 255).all()
    view = view_of(grid)
    expected = tint_costs(draw_classes(grid, view), grid, costmap.costs, view)
    np.testing.assert_array_equal(picture[..., :3], expected)
    assert (picture[(expected == UNKNOWN_COLOR).all(axis=-1), 3] == 0).all()


def test_timings_are_those_of_the_pipeline(run: tuple[list[StepResult], ObstacleMapper, Rows]) -> None:
    steps, _, rows = run
    for i, step in enumerate(steps):
        for stage, milliseconds in {"read": 2.5, **step.timings_ms}.items():
            assert numbers(rows[f"/timings/{stage}"]["Scalars:scalars"][i]).tolist() == [milliseconds]
        total = numbers(rows["/latency/pipeline"]["Scalars:scalars"][i])
        assert total.tolist() == [sum(step.timings_ms.values())]
    assert "/latency/image" not in rows  # of a recording it would say nothing


def test_frames_without_a_pose_show_each_its_own_map(tmp_path: Path) -> None:
    config = config_from_dict({"mount": {"height_m": 0.9, "pitch_deg": 22}})
    mapper = ObstacleMapper(Half(), config)
    seen = []
    with rerun_sink(tmp_path / "a.rrd") as sink:
        stream = RerunStream(sink, config, live=True, jpeg_quality=90)
        for frame in frames(3):
            step = mapper.step(replace(frame, T_map_camera=None))
            seen.append(step)
            stream.add(step, mapper)
        stream.finish(mapper)
    rows = read(tmp_path / "a.rrd")
    for i, step in enumerate(seen):
        classes = image(rows, "/map/classes", "SegmentationImage", i)[::-1]
        np.testing.assert_array_equal(classes, step.seen.classes)
        blob = numbers(rows["/world/camera/photo"]["EncodedImage:blob"][i])
        photo = cv2.cvtColor(cv2.imdecode(blob, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
        assert np.abs(photo.astype(int) - step.frame.rgb).mean() < 8
        assert numbers(rows["/latency/image"]["Scalars:scalars"][i])[0] > 0


def test_a_stamp_before_2000_counts_from_the_beginning(tmp_path: Path) -> None:
    mapper = ObstacleMapper(Half(), CONFIG)
    with rerun_sink(tmp_path / "a.rrd") as sink:
        stream = RerunStream(sink, CONFIG)
        for frame in frames(2):
            stream.add(mapper.step(replace(frame, stamp_ns=frame.stamp_ns - START_NS + 5)), mapper)
    assert list(read(tmp_path / "a.rrd")["/world/cloud"]["stamp"].values()) == [5, 200_000_005]


def test_a_huge_map_is_drawn_smaller() -> None:
    from swardmap.grid import GridSpec, OccupancyGrid

    grid = OccupancyGrid(GridSpec(0.05, 4000, 1000), np.ones((1000, 4000), np.uint8))
    view = view_of(grid)
    assert max(view.width, view.height) <= 1025
    assert view.width / view.px_per_m >= 200.0


def test_a_file_is_whole_or_not_there(tmp_path: Path) -> None:
    path, mapper = tmp_path / "new/a.rrd", ObstacleMapper(Half(), CONFIG)

    def fails() -> None:
        with rerun_sink(path) as sink:
            RerunStream(sink, CONFIG).add(mapper.step(next(frames())), mapper)
            raise KeyError

    with pytest.raises(KeyError):
        fails()
    assert list(path.parent.iterdir()) == []
    with rerun_sink(path) as sink:
        sink.stream.log("a", load_rerun().Scalars(1.0))
    before = path.read_bytes()
    with pytest.raises(OutputError, match="--overwrite"), rerun_sink(path):
        pass
    with pytest.raises(OutputError, match=r"ends in \.rrd"), rerun_sink(tmp_path / "a.bag"):
        pass
    with (
        pytest.raises(OutputError, match=r"cannot write /proc/no/a\.rrd"),
        rerun_sink(Path("/proc/no/a.rrd")),
    ):
        pass
    assert path.read_bytes() == before
    with rerun_sink(path, overwrite=True) as sink:
        sink.stream.log("b", load_rerun().Scalars(1.0))
    assert "/b" in (found := read(path))
    assert "/a" not in found
    assert [p.name for p in path.parent.iterdir()] == ["a.rrd"]


class Dead:
    """As Rerun's stream is when its thread could not write."""

    def flush(self, timeout_sec: float) -> None:
        raise RuntimeError("File-writer thread shut down prematurely")


def test_a_stream_that_does_not_arrive_is_one_error_and_leaves_nothing(tmp_path: Path) -> None:
    def work() -> None:
        with rerun_sink(tmp_path / "a.rrd") as sink:
            replace(sink, stream=Dead()).arrive()

    with pytest.raises(OutputError, match=r"cannot write .*a\.rrd: .*shut down"):
        work()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_called_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 4096}))
    with pytest.raises(OutputError, match=r"^cannot write a\.rrd: the disk is full$"):
        RerunSink(Dead(), "cannot write a.rrd", tmp_path).arrive()


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("rerun+http://127.0.0.1:9/proxy", "refused"),
        ("127.0.0.1:9876", "no such address"),
        ("http://x:1", "such"),
    ],
)
def test_a_viewer_that_is_not_there(url: str, why: str) -> None:
    with pytest.raises(OutputError, match=f"no Rerun viewer answers at .*{why}"), rerun_sink(connect=url):
        pass


def test_without_a_screen_no_viewer_is_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(OutputError, match=r"--save FILE\.rrd"), rerun_sink():
        pass


def test_a_missing_package_names_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'swardmap\[view\]'"), rerun_sink(connect="x"):
        pass
