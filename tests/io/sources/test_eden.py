"""EDEN: what is written in its layout comes back, and what is missing or damaged is named or counted."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import loadmat, savemat

from swardmap.config import SourceConfig
from swardmap.errors import InputError, InvalidValueError, OutputError
from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.io import FrameSource, open_source
from swardmap.io.sources.eden import open_source as open_eden
from swardmap.io.sources.eden import write_eden
from swardmap.io.sources.eden_labels import TRIMBOT, label_table_yaml, read_label_table
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.types import Frame
from tests.io.contract import check_source

K = Intrinsics(12, 9, 10.5, 11.25, 5.5, 4.0)
WITH_POSES = SourceConfig(level=False)


def frames(n: int = 3, seed: int = 0) -> list[Frame]:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.2, 30, (n, 9, 12)).astype(np.float32)
    depth[:, 0, :3] = np.nan, np.inf, 0
    return [
        Frame(
            stamp_ns=i * 100_000_000,
            intrinsics=replace(K, fx=10.5 + i / 3),
            rgb=rng.integers(0, 256, (9, 12, 3)).astype(np.uint8),
            depth=depth[i],
            T_map_camera=mount_pose(0.9 + i, 20.0, roll_deg=3.0, yaw_deg=7.0 * i, parent="map"),
            labels=rng.choice([0, 1, 2, 255], (9, 12)).astype(np.uint8),
            label_set=GRASS_OBSTACLE_PERSON,
        )
        for i in range(n)
    ]


@pytest.fixture
def eden(tmp_path: Path) -> Path:
    """Two scenes, three sequences, with labels in EDEN's own ids."""
    root = tmp_path / "EDEN"
    rng = np.random.default_rng(3)
    for k, (scene, light) in enumerate([("0003", "clear"), ("0003", "sunset"), ("0010", "clear")]):
        own = [
            replace(f, labels=rng.integers(0, 10, (9, 12)).astype(np.uint8), label_set=TRIMBOT)
            for f in frames(3, seed=k)
        ]
        assert write_eden(own, root, scene=scene, illumination=light) == 3
    (root / "label_table.yaml").unlink()  # EDEN has none
    return root


def read(path: Path, config: SourceConfig | None = None) -> tuple[list[Frame], FrameSource]:
    source = open_source(path, config)
    return list(source), source


def first(root: Path, modality: str) -> Path:
    return min((root / modality / "0003" / "clear").iterdir())


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    written = frames()
    assert write_eden(written, tmp_path, scene="0042", illumination="twilight") == 3
    again = check_source(lambda: open_source(tmp_path, WITH_POSES))
    for one, two in zip(written, again, strict=True):
        assert one.intrinsics == two.intrinsics
        assert two.label_set == GRASS_OBSTACLE_PERSON
        assert two.depth.dtype == np.float32
        assert one.labels is not None
        assert two.labels is not None
        for a, b in ((one.rgb, two.rgb), (one.depth, two.depth), (one.labels, two.labels)):
            np.testing.assert_array_equal(a, b)
        assert one.T_map_camera is not None
        assert two.T_map_camera is not None
        np.testing.assert_allclose(one.T_map_camera.matrix, two.T_map_camera.matrix, atol=1e-12)
        assert two.tags == {"scene": "0042", "illumination": "twilight"}
    assert [f.name for f in again] == [f"0042-twilight-0000{i}" for i in (1, 2, 3)]


def test_files_are_what_other_readers_of_eden_expect(tmp_path: Path) -> None:
    (frame,) = frames(1)
    write_eden([frame], tmp_path, scene="0001", illumination="clear")
    depth = loadmat(tmp_path / "Depth/0001/clear/00001_L.mat")["Depth"]
    assert depth.shape == (9, 12, 1)
    np.testing.assert_array_equal(depth[..., 0], frame.depth)
    camera = loadmat(tmp_path / "cam_matrix/0001/clear/00001.mat")
    np.testing.assert_array_equal(camera["K_L"], frame.intrinsics.matrix)
    point = np.array([1.0, 2.0, 0.5])
    assert frame.T_map_camera is not None
    in_camera = camera["RT_L"] @ [*point, 1]
    np.testing.assert_allclose(frame.T_map_camera.apply(in_camera), point, atol=1e-12)
    assert (tmp_path / "RGB/0001/clear/00001_L.png").is_file()
    assert (tmp_path / "Segmentation/0001/clear/00001_L_Sem.png").is_file()


def test_equal_frames_give_equal_bytes(tmp_path: Path) -> None:
    for name in "ab":
        write_eden(frames(), tmp_path / name)
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert len(files) == 3 * 4 + 1
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_millimetres_become_metres(tmp_path: Path) -> None:
    (frame,) = frames(1)
    depth = np.arange(9 * 12, dtype=np.uint16).reshape(9, 12) * 7
    write_eden([replace(frame, depth=depth, depth_unit_m=0.001)], tmp_path)
    (back,), _ = read(tmp_path)
    np.testing.assert_array_equal(back.depth_m, replace(frame, depth=depth, depth_unit_m=0.001).depth_m)


@pytest.mark.parametrize(
    ("part", "count"),
    [("", 9), ("RGB", 9), ("Depth/0003", 6), ("RGB/0003", 6), ("RGB/0003/sunset", 3), ("cam_matrix/0010", 3)],
)
def test_the_root_a_scene_or_a_light_can_be_named(eden: Path, part: str, count: int) -> None:
    found = check_source(lambda: open_source(eden / part))
    assert len(found) == count
    assert [f.stamp_ns for f in found] == [i * 100_000_000 for i in range(count)]
    if "/" in part:
        assert {f.tags["scene"] for f in found} == {part.split("/")[1]}


def test_order_is_by_scene_light_and_number(eden: Path) -> None:
    for modality in ("RGB", "Depth", "Segmentation", "cam_matrix"):  # 10 comes after 9
        old = first(eden, modality)
        old.rename(old.with_name(old.name.replace("00001", "10")))
    found, source = read(eden)
    assert [f.name for f in found] == (
        [f"0003-clear-{n}" for n in ("00002", "00003", "10")]
        + [f"0003-sunset-0000{n}" for n in (1, 2, 3)]
        + [f"0010-clear-0000{n}" for n in (1, 2, 3)]
    )
    assert source.frame_count == 9


@given(st.integers(0, 10), st.one_of(st.none(), st.integers(0, 10)), st.integers(1, 4))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=20)
def test_start_stop_and_every_take_the_same_frames_as_a_slice(
    eden: Path, start: int, stop: int | None, every: int
) -> None:
    whole, _ = read(eden)
    part, source = read(eden, SourceConfig(start=start, stop=stop, every=every))
    wanted = whole[start:stop:every]
    assert [(f.name, f.stamp_ns) for f in part] == [(f.name, f.stamp_ns) for f in wanted]
    assert source.frame_count == len(wanted)


def test_opening_reads_no_frame(tmp_path: Path) -> None:
    for modality, ending in (("RGB", "_L.png"), ("Depth", "_L.mat"), ("cam_matrix", ".mat")):
        folder = tmp_path / modality / "0003" / "clear"
        folder.mkdir(parents=True)
        for i in range(500):
            (folder / f"{i:05d}{ending}").touch()  # empty: to read one is an error
    source = open_source(tmp_path)
    assert source.frame_count == 500
    with pytest.raises(InputError):
        next(iter(source))


def test_levelled_frames_stand_alone_because_up_is_unknown(eden: Path) -> None:
    assert all(f.T_map_camera is None for f in read(eden)[0])
    assert all(f.T_map_camera is not None for f in read(eden, WITH_POSES)[0])


def test_a_camera_matrix_without_pose_is_counted(eden: Path) -> None:
    savemat(first(eden, "cam_matrix"), {"K_L": K.matrix})
    found, source = read(eden, WITH_POSES)
    assert found[0].T_map_camera is None
    assert source.skipped == {"no RT_L in the camera matrix; frame used without a pose": 1}
    assert read(eden)[1].skipped == {}


@pytest.mark.parametrize(
    ("modality", "reason"),
    [("RGB", "no colour image"), ("Depth", "no depth file"), ("cam_matrix", "no camera matrix")],
)
def test_a_frame_that_lacks_a_file_is_counted(eden: Path, modality: str, reason: str) -> None:
    first(eden, modality).unlink()
    found, source = read(eden)
    assert len(found) == 8
    assert source.frame_count == 9
    assert source.skipped == {reason: 1}
    check_source(lambda: open_source(eden))


def test_a_frame_without_segmentation_is_kept_without_labels(eden: Path) -> None:
    first(eden, "Segmentation").unlink()
    found, source = read(eden)
    assert found[0].labels is None
    assert found[1].labels is not None
    assert source.skipped == {"no segmentation; frame used without labels": 1}
    shutil.rmtree(eden / "Segmentation")
    found, source = read(eden)
    assert source.label_set is None
    assert source.skipped == {}
    assert all(f.labels is None for f in found)


def test_missing_camera_matrices_are_named_unless_a_camera_is_declared(eden: Path, tmp_path: Path) -> None:
    shutil.rmtree(eden / "cam_matrix")
    with pytest.raises(InputError, match=r"cam_matrix/0003/clear: the camera matrices are missing"):
        open_source(eden)
    table = tmp_path / "table.yaml"
    table.write_text("camera: {width: 12, height: 9, fx: 640, fy: 640, cx: 6, cy: 4.5}")
    found, source = read(eden, SourceConfig(label_table=str(table), level=False))
    assert len(found) == 9
    assert {f.intrinsics for f in found} == {Intrinsics(12, 9, 640.0, 640.0, 6.0, 4.5)}
    assert source.label_set == TRIMBOT
    assert source.skipped == {"no camera matrix; frame used with the camera of the label table": 9}


def test_a_declared_camera_of_another_size_is_refused(eden: Path, tmp_path: Path) -> None:
    first(eden, "cam_matrix").unlink()
    table = tmp_path / "table.yaml"
    table.write_text("camera: {width: 640, height: 480, fx: 640, fy: 640, cx: 320, cy: 240}")
    with pytest.raises(InputError, match=r"0003-clear-00001.*expected uint8 of shape"):
        read(eden, SourceConfig(label_table=str(table)))


def test_default_ids_are_trimbots(eden: Path) -> None:
    table = TRIMBOT.map_class_table
    assert [int(i) for i in np.nonzero(table == MapClass.GRASS)[0]] == [1]
    assert [int(i) for i in np.nonzero(table == MapClass.OBSTACLE)[0]] == [2, 3, 4, 5, 6, 7, 8]
    assert table[0] == table[9] == table[10] == table[255] == MapClass.UNKNOWN
    assert read(eden)[1].label_set == TRIMBOT


def test_ids_keep_their_numbers_and_undeclared_ones_are_counted(eden: Path, tmp_path: Path) -> None:
    table = tmp_path / "table.yaml"
    table.write_text(
        "1: {name: grass, role: free}\n"
        "7: {name: obstacle, role: obstacle, color: [1, 2, 3]}\n"
        "8: {name: gardener, role: person}\n"
    )
    whole, _ = read(eden)
    found, source = read(eden, SourceConfig(label_table=str(table)))
    assert source.label_set is not None
    assert source.label_set["obstacle"].color == (1, 2, 3)
    ids = np.stack([f.labels for f in whole if f.labels is not None])
    np.testing.assert_array_equal(ids, np.stack([f.labels for f in found if f.labels is not None]))
    classes = source.label_set.map_class_table[ids]
    assert set(np.unique(classes[ids == 8])) == {MapClass.PERSON}
    assert set(np.unique(classes[(ids != 1) & (ids != 7) & (ids != 8)])) == {MapClass.UNKNOWN}
    undeclared = {i: int((ids == i).sum()) for i in (0, 2, 3, 4, 5, 6, 9)}
    assert source.skipped == {
        f"pixels of id {i}, not in the label table: void": n for i, n in undeclared.items()
    }


def test_a_label_table_comes_back(tmp_path: Path) -> None:
    for label_set in (TRIMBOT, GRASS_OBSTACLE_PERSON):
        (tmp_path / "t.yaml").write_text(label_table_yaml(label_set))
        assert read_label_table(tmp_path / "t.yaml").label_set == label_set


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "just words",
        "1: grass",
        "grass: {name: grass, role: free}",
        "1: {name: grass, role: meadow}",
        "1: {name: grass}",
        "1: {name: grass, role: free, colour: [1, 2, 3]}",
        "1: {name: grass, role: free, color: [1, 2]}",
        "1: {name: grass, role: free, color: 7}",
        "1: {name: grass, role: [free]}",
        "256: {name: grass, role: free}",
        "1: {name: a, role: free}\n2: {name: a, role: obstacle}",
        "camera: {fx: 640}",
        "camera: {width: 640, height: 480, fx: 0, fy: 640, cx: 320, cy: 240}",
        "camera: {width: 640, height: 480, fx: wide, fy: 640, cx: 320, cy: 240}",
        "!!python/object/apply:os.system ['true']",
        "1: {name: [",
    ],
)
def test_a_bad_label_table_is_refused(eden: Path, tmp_path: Path, text: str) -> None:
    table = tmp_path / "table.yaml"
    table.write_text(text)
    with pytest.raises(InputError, match=r"table\.yaml"):
        open_source(eden, SourceConfig(label_table=str(table)))


def replaced(**arrays: object) -> Callable[[Path], None]:
    return lambda file: savemat(file, arrays)


def truncated(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-20])


def half(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:150])


def emptied(file: Path) -> None:
    file.write_bytes(b"")


def as_hdf5(file: Path) -> None:
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124)
    file.write_bytes(text + b"\x00\x02IM" + bytes(384) + b"\x89HDF\r\n\x1a\n" + bytes(64))


@pytest.mark.parametrize(
    ("modality", "damage", "message"),
    [
        ("Depth", truncated, "truncated"),
        ("Depth", half, "truncated"),
        ("Depth", emptied, "got 0 bytes"),
        ("Depth", as_hdf5, "HDF5"),
        ("Depth", replaced(depth=np.ones((9, 12))), "expected an array Depth"),
        ("Depth", replaced(Depth=np.ones((12, 9, 1))), "expected uint16 or float32 of shape"),
        ("Depth", replaced(Depth=np.ones((9, 12, 1, 1, 2))), "H x W x k"),
        ("Depth", replaced(Depth="words"), "real numbers"),
        ("Depth", replaced(Depth=np.ones((9, 12)) * 1j), "real numbers"),
        ("cam_matrix", truncated, "truncated"),
        ("cam_matrix", replaced(K_R=K.matrix), "3 x 3 matrix K_L, got nothing"),
        ("cam_matrix", replaced(K_L=np.ones((2, 2))), r"got shape \(2, 2\)"),
        ("cam_matrix", replaced(K_L=np.zeros((3, 3))), "positive focal lengths"),
        ("cam_matrix", replaced(K_L=np.full((3, 3), np.nan)), "finite"),
        ("cam_matrix", replaced(K_L=K.matrix, RT_L=np.eye(3)), "3 x 4 matrix RT_L"),
        ("cam_matrix", replaced(K_L=K.matrix, RT_L=2 * np.eye(4)[:3]), "rotation"),
        ("cam_matrix", replaced(K_L=K.matrix, RT_L=np.full((3, 4), np.nan)), "finite"),
        ("RGB", truncated, "truncated"),
        ("RGB", emptied, "expected a PNG, JPEG"),
        ("Segmentation", truncated, "truncated"),
    ],
)
def test_a_damaged_file_is_named(
    eden: Path, modality: str, damage: Callable[[Path], None], message: str
) -> None:
    file = first(eden, modality)
    damage(file)
    with pytest.raises(InputError, match=message) as caught:
        read(eden, WITH_POSES)
    assert str(file) in str(caught.value) or "0003-clear-00001" in str(caught.value)


def test_a_mask_of_another_size_is_refused(eden: Path) -> None:
    shutil.copy(first(eden, "RGB"), first(eden, "Segmentation"))
    with pytest.raises(InputError, match="single-channel mask"):
        read(eden)


def test_depth_may_be_flat_or_have_more_channels_and_other_types(eden: Path) -> None:
    values = np.random.default_rng(0).uniform(1, 9, (9, 12, 3))
    for array in (values, values[..., 0], values.astype(np.float32), (values * 10).astype(np.uint16)):
        savemat(first(eden, "Depth"), {"Depth": array})
        found = read(eden / "RGB" / "0003")[0][0]
        wanted = array if array.ndim == 2 else array[..., 0]
        np.testing.assert_array_equal(found.depth, wanted.astype(np.float32))


def test_what_is_no_eden_is_not_recognised(tmp_path: Path, eden: Path) -> None:
    for path in (tmp_path, tmp_path / "plain"):
        path.mkdir(exist_ok=True)
        with pytest.raises(InputError, match="not a recording"):
            open_source(path)
    with pytest.raises(InputError, match="expected EDEN's folders"):
        open_eden(tmp_path / "plain", SourceConfig())
    (eden / "RGB" / "0003" / "noon").mkdir()
    with pytest.raises(InputError, match="not a recording"):
        open_source(eden / "RGB" / "0003" / "noon")
    (eden / "RGB" / "0044" / "clear").mkdir(parents=True)
    with pytest.raises(InputError, match=r"0044/clear: the camera matrices are missing"):
        open_source(eden)
    (eden / "cam_matrix" / "0044" / "clear").mkdir(parents=True)
    with pytest.raises(InputError, match="no frame found"):
        open_source(eden / "RGB" / "0044")


def test_modalities_may_be_links(eden: Path, tmp_path: Path) -> None:
    linked = tmp_path / "linked"
    linked.mkdir()
    for modality in ("RGB", "Depth", "cam_matrix"):
        (linked / modality).symlink_to(eden / modality)
    found, source = read(linked / "RGB" / "0010")
    assert len(found) == 3
    assert source.name == "linked-0010"
    assert source.label_set is None


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    for scene, light in (("3", "clear"), ("../1", "clear"), ("0003", "noon"), ("00031", "clear")):
        with pytest.raises(InvalidValueError, match="four digits"):
            write_eden(frames(1), tmp_path, scene=scene, illumination=light)
    with pytest.raises(InvalidValueError, match="no frame"):
        write_eden([], tmp_path)
    write_eden(frames(1), tmp_path)
    with pytest.raises(OutputError, match="exists"):
        write_eden(frames(1), tmp_path)
    other = [replace(f, label_set=TRIMBOT) for f in frames(1)]
    with pytest.raises(InvalidValueError, match="other classes"):
        write_eden(other, tmp_path, scene="0002")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        write_eden(frames(1), tmp_path / "file")


def test_a_frame_without_pose_and_labels_can_be_written(tmp_path: Path) -> None:
    bare = [replace(f, T_map_camera=None, labels=None, label_set=None) for f in frames(2)]
    write_eden(bare, tmp_path)
    found, source = read(tmp_path)
    assert source.label_set is None
    assert [f.T_map_camera for f in found] == [None, None]


def test_poses_are_inverted_from_world_to_camera(eden: Path) -> None:
    T_camera_map = Pose("camera", "map", mount_pose(1.2, 10.0).inverse().matrix)
    savemat(first(eden, "cam_matrix"), {"K_L": K.matrix, "RT_L": T_camera_map.matrix[:3]})
    pose = read(eden, WITH_POSES)[0][0].T_map_camera
    assert pose is not None
    np.testing.assert_allclose(pose.position_m, [0, 0, 1.2], atol=1e-12)
