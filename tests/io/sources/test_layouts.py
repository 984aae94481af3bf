"""Public layouts, written here from rendered frames and read back: images, units, cameras, poses, times."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from swardmap.config import SourceConfig, load_config
from swardmap.errors import ConfigError, InputError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io import FrameSource, open_source
from swardmap.io.sources.images import stamp_in_name
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.types import Frame, depth_in_metres
from tests.io.contract import check_source

SMALL = Intrinsics(80, 60, 60.0, 60.0, 39.5, 29.5)
N = 5
T0_NS = 1_305_031_102_175_304_000


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return list(AnalyticSource(garden_scene(2), tuple(lane_poses(N, step_m=0.3)), SMALL))


def metres(frame: Frame) -> NDArray[np.float32]:
    return depth_in_metres(frame.depth, frame.depth_unit_m)


def units(frame: Frame, per_m: float) -> NDArray[np.uint16]:
    depth = np.nan_to_num(metres(frame), nan=0, posinf=0)
    return np.asarray(np.clip(np.round(depth * per_m), 0, 65535), np.uint16)


def save(file: Path, image: NDArray[np.generic]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(file), image[..., ::-1] if image.ndim == 3 else image)


def pose_of(frame: Frame) -> Pose:
    assert frame.T_map_camera is not None
    return frame.T_map_camera


def quaternion_line(matrix: NDArray[np.float64]) -> str:
    numbers = (*matrix[:3, 3], *Rotation.from_matrix(matrix[:3, :3]).as_quat())
    return " ".join(f"{v:.9f}" for v in numbers)


def stamp(i: int) -> str:
    ns = T0_NS + i * 100_000_000
    return f"{ns // 10**9}.{ns % 10**9 // 1000:06d}"


def same(found: list[Frame], given: list[Frame], depth_m: float, names: list[str] | None = None) -> None:
    assert len(found) == len(given)
    if names is not None:
        assert [f.name for f in found] == names
    for one, two in zip(found, given, strict=True):
        assert one.intrinsics == two.intrinsics
        np.testing.assert_array_equal(one.rgb, two.rgb)
        near = np.isfinite(metres(two)) & (metres(two) < 12)
        np.testing.assert_allclose(metres(one)[near], metres(two)[near], atol=depth_m)
        if one.T_map_camera is not None:
            np.testing.assert_allclose(one.T_map_camera.matrix, pose_of(two).matrix, atol=1e-6)


def opened(folder: Path, *settings: str) -> Callable[[], FrameSource]:
    config = load_config(overrides=[f"source.{s}" for s in settings])
    return lambda: open_source(folder, config)


INTRINSICS = "intrinsics=[60,60,39.5,29.5]"


def write_tum(folder: Path, frames: list[Frame], lag_us: int = 3000) -> None:
    """Depth comes later than colour; poses ten times as often, and at neither's times."""
    lists: dict[str, list[str]] = {"rgb": ["# color images"], "depth": ["# depth maps"]}
    for i, frame in enumerate(frames):
        late_ns = T0_NS + i * 100_000_000 + lag_us * 1000
        late = f"{late_ns // 10**9}.{late_ns % 10**9 // 1000:06d}"
        save(folder / "rgb" / f"{stamp(i)}.png", frame.rgb)
        save(folder / "depth" / f"{late}.png", units(frame, 5000))
        lists["rgb"].append(f"{stamp(i)} rgb/{stamp(i)}.png")
        lists["depth"].append(f"{late} depth/{late}.png")
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    first, last = pose_of(frames[0]).matrix, pose_of(frames[-1]).matrix
    poses = ["# timestamp tx ty tz qx qy qz qw"]
    for k in range(-5, 10 * (len(frames) - 1) + 6):  # lanes are straight: poses lie on a line
        share = (k + 0.5) / (10 * (len(frames) - 1))
        matrix = first.copy()
        matrix[:3, 3] = (1 - share) * first[:3, 3] + share * last[:3, 3]
        ns = T0_NS + int((k + 0.5) * 10_000_000)
        poses.append(f"{ns // 10**9}.{ns % 10**9 // 1000:06d} {quaternion_line(matrix)}")
    (folder / "groundtruth.txt").write_text("\n".join(poses) + "\n")


def test_tum(frames: list[Frame], tmp_path: Path) -> None:
    write_tum(tmp_path, frames)
    found = check_source(opened(tmp_path, INTRINSICS))
    same(found, frames, 1 / 5000, [stamp(i) for i in range(N)])
    assert [f.stamp_ns for f in found] == [T0_NS + i * 100_000_000 for i in range(N)]
    assert [f.name for f in opened(tmp_path, INTRINSICS, "start=1", "every=2")()] == [stamp(1), stamp(3)]


def test_tum_with_associations_without_poses(frames: list[Frame], tmp_path: Path) -> None:
    write_tum(tmp_path, frames, lag_us=45_000)
    with pytest.raises(InputError, match=r"source\.pair_tolerance_ms"):
        opened(tmp_path)()
    lines = [
        f"{c} {d}"
        for c, d in zip(
            *((tmp_path / f"{n}.txt").read_text().splitlines()[1:] for n in ("rgb", "depth")), strict=True
        )
    ]
    (tmp_path / "associations.txt").write_text("\n".join(lines))
    (tmp_path / "groundtruth.txt").unlink()
    found = check_source(opened(tmp_path, INTRINSICS))
    same(found, frames, 1 / 5000)
    assert all(f.T_map_camera is None for f in found)


def test_tum_beyond_its_poses_is_counted_and_the_camera_is_its_authors(
    frames: list[Frame], tmp_path: Path
) -> None:
    write_tum(tmp_path, frames)
    file = tmp_path / "groundtruth.txt"
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:20]))
    source = opened(tmp_path, INTRINSICS)()
    assert len(list(source)) == 2
    assert source.skipped == {"no pose near in time": 3}
    with pytest.raises(InputError, match=r"principal point.*source\.intrinsics"):
        list(opened(tmp_path)())  # 319.5 lies outside of an image of 80 pixels
    file.write_text("1 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 1\n")
    with pytest.raises(InputError, match="line 2: expected poses in order of time"):
        opened(tmp_path)()
    (tmp_path / "rgb.txt").write_text("1305031102.1 ../../etc/passwd\n")
    with pytest.raises(InputError, match=r"rgb\.txt, line 1"):
        opened(tmp_path)()


def write_seven_scenes(folder: Path, frames: list[Frame]) -> None:
    for i, frame in enumerate(frames):
        stem = folder / "seq-01" / f"frame-{i:06d}"
        save(stem.with_suffix(".color.png"), frame.rgb)
        save(stem.with_suffix(".depth.png"), np.where(units(frame, 1000) == 0, 65535, units(frame, 1000)))
        np.savetxt(stem.with_suffix(".pose.txt"), pose_of(frame).matrix)


def test_seven_scenes(frames: list[Frame], tmp_path: Path) -> None:
    write_seven_scenes(tmp_path, frames)
    with pytest.raises(InputError, match=r"source\.intrinsics=\[fx,fy,cx,cy\] \(7-Scenes"):
        opened(tmp_path)()
    found = check_source(opened(tmp_path, INTRINSICS, "level=false"))
    same(found, frames, 1e-3)
    (tmp_path / "TrainSplit.txt").write_text("sequence1\n")
    for i, frame in enumerate(frames):
        big = cv2.resize(frame.rgb, (640, 480)), cv2.resize(units(frame, 1000), (640, 480))
        save(tmp_path / f"seq-01/frame-{i:06d}.color.png", big[0])
        save(tmp_path / f"seq-01/frame-{i:06d}.depth.png", big[1])
    assert next(iter(opened(tmp_path, "level=false")())).intrinsics == Intrinsics(
        640, 480, 585, 585, 320, 240
    )


def write_scannet(folder: Path, frames: list[Frame], scale: int = 1) -> None:
    for i, frame in enumerate(frames):
        rgb = np.repeat(np.repeat(frame.rgb, scale, axis=0), scale, axis=1)
        save(folder / "color" / f"{i}.png", rgb)
        save(folder / "depth" / f"{i}.png", units(frame, 1000))
        (folder / "pose").mkdir(exist_ok=True)
        np.savetxt(folder / "pose" / f"{i}.txt", pose_of(frame).matrix)
    (folder / "intrinsic").mkdir()
    K = np.diag([60.0, 60, 1, 1])
    K[0, 2], K[1, 2] = 39.5, 29.5
    np.savetxt(folder / "intrinsic/intrinsic_depth.txt", K)
    K[:2] *= scale
    K[:2, 2] += (scale - 1) / 2
    np.savetxt(folder / "intrinsic/intrinsic_color.txt", K)
    np.savetxt(folder / "intrinsic/extrinsic_depth.txt", np.eye(4))


@pytest.mark.parametrize("scale", [1, 3])
def test_scannet(frames: list[Frame], scale: int, tmp_path: Path) -> None:
    write_scannet(tmp_path, frames, scale)
    np.savetxt(tmp_path / "pose/2.txt", np.full((4, 4), -np.inf))
    (tmp_path / "depth/3.png").unlink()
    source = opened(tmp_path)
    found = check_source(source)
    same(found, [frames[i] for i in (0, 1, 4)], 1e-3, ["000000", "000001", "000004"])
    again = source()
    list(again)
    assert again.skipped == {"tracking lost": 1, "no depth image": 1}
    apart = np.eye(4)
    apart[0, 3] = 0.05
    np.savetxt(tmp_path / "intrinsic/extrinsic_depth.txt", apart)
    with pytest.raises(InputError, match="expected the identity"):
        opened(tmp_path)()


T_NED_MAP = np.diag([1.0, -1, -1, 1])
T_OPTICAL_NED = np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])  # p_optical of p_ned


@pytest.mark.parametrize("camera", ["left", "lcam_front"])
def test_tartanair(camera: str, frames: list[Frame], tmp_path: Path) -> None:
    lines = []
    for i, frame in enumerate(frames):
        save(tmp_path / f"image_{camera}" / f"{i:06d}_{camera}.png", frame.rgb)
        depth = tmp_path / f"depth_{camera}" / f"{i:06d}_{camera}_depth"
        depth.parent.mkdir(exist_ok=True)
        far = np.nan_to_num(metres(frame), nan=10_000, posinf=10_000).astype("<f4")
        if camera == "left":
            np.save(depth.with_suffix(".npy"), far)
        else:
            cv2.imwrite(str(depth.with_suffix(".png")), far[..., None].view(np.uint8))
        lines.append(quaternion_line(T_NED_MAP @ pose_of(frame).matrix @ T_OPTICAL_NED))
    (tmp_path / f"pose_{camera}.txt").write_text("\n".join(lines))
    found = check_source(opened(tmp_path, INTRINSICS))
    same(found, frames, 1e-6, [f"{i:06d}" for i in range(N)])
    (tmp_path / f"pose_{camera}.txt").write_text(lines[0])
    with pytest.raises(InputError, match="one pose for each of the 5 images, got 1"):
        opened(tmp_path)()


PATTERNS = ("format=images", "color_files=a/*.png", "depth_files=b/*.tif", INTRINSICS)


def write_images(
    folder: Path, frames: list[Frame], color: Callable[[int], str], depth: Callable[[int], str]
) -> None:
    for i, frame in enumerate(frames):
        save(folder / "a" / f"{color(i)}.png", frame.rgb)
        save(folder / "b" / f"{depth(i)}.tif", units(frame, 1000))


def test_images_by_the_numbers_in_their_names(frames: list[Frame], tmp_path: Path) -> None:
    write_images(tmp_path, frames, lambda i: f"img_{i + 8}", lambda i: f"depth{i + 8:05d}")  # 10 after 9
    (tmp_path / "kitti.txt").write_text(
        "\n".join(" ".join(map(str, pose_of(f).matrix[:3].ravel())) for f in frames)
    )
    found = check_source(opened(tmp_path, *PATTERNS, "poses_file=kitti.txt"))
    same(found, frames, 1e-3, [f"img_{i + 8}" for i in range(N)])
    (tmp_path / "b/depth00009.tif").unlink()
    source = opened(tmp_path, *PATTERNS, "poses_file=kitti.txt")()
    same(list(source), [f for i, f in enumerate(frames) if i != 1], 1e-3)
    assert source.skipped == {"no depth image": 1}
    (tmp_path / "kitti.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    with pytest.raises(InputError, match="one pose for each of 5 colour images, got 1"):
        opened(tmp_path, *PATTERNS, "poses_file=kitti.txt")()


def test_images_whose_names_do_not_agree_are_asked_for(frames: list[Frame], tmp_path: Path) -> None:
    write_images(
        tmp_path, frames, lambda i: stamp(i), lambda i: stamp(i)[:-6] + f"{int(stamp(i)[-6:]) + 4000:06d}"
    )
    with pytest.raises(InputError, match=r"source\.pair_by to name, time or order"):
        opened(tmp_path, *PATTERNS)()
    write_tum(tmp_path / "tum", frames)
    (tmp_path / "poses.txt").write_bytes((tmp_path / "tum/groundtruth.txt").read_bytes())
    for how in ("time", "order"):
        found = check_source(opened(tmp_path, *PATTERNS, f"pair_by={how}", "poses_file=poses.txt"))
        same(found, frames, 1e-3, [stamp(i) for i in range(N)])
        assert found[0].stamp_ns == T0_NS
    with pytest.raises(ConfigError, match=r"source\.color_files"):
        opened(tmp_path, "format=images")()
    with pytest.raises(ConfigError, match=r"the camera is not said: --set source\.intrinsics"):
        opened(tmp_path, *PATTERNS[:-1])()
    with pytest.raises(InputError, match="no file fits 'c/"):
        opened(tmp_path, *PATTERNS, "color_files=c/*.png")()
    with pytest.raises(InputError, match="inside"):
        opened(tmp_path, *PATTERNS, "color_files=../*.png")()


def test_poses_with_times_need_names_that_are_times(frames: list[Frame], tmp_path: Path) -> None:
    write_images(tmp_path, frames, lambda i: f"{i:09d}", lambda i: f"{i}")
    write_tum(tmp_path / "tum", frames)
    with pytest.raises(InputError, match="the poses have times, but the name is none"):
        opened(tmp_path, *PATTERNS, "poses_file=tum/groundtruth.txt")()


@pytest.mark.parametrize(
    ("name", "ns"),
    [("1305031102.175304", T0_NS), ("x_1700000000123", 1_700_000_000_123_000_000),
     ("1700000000", 1_700_000_000 * 10**9),
     ("1700000000123456", 1_700_000_000_123_456_000), ("1700000000123456789", 1_700_000_000_123_456_789),
     ("000000001", None), ("frame12", None)],
)  # fmt: skip
def test_times_in_names(name: str, ns: int | None) -> None:
    assert stamp_in_name(Path(f"{name}.png")) == ns


def test_the_settings_of_a_source_are_checked() -> None:
    with pytest.raises(ConfigError, match="pair_by"):
        SourceConfig(pair_by="luck")


def write_rellis(folder: Path, scans: int = 3) -> NDArray[np.float32]:
    """A scan of a plane 5 m ahead, left half grass, right half person, one point behind the camera."""
    y, z = np.meshgrid(np.linspace(-1.5, 1.5, 60), np.linspace(-0.9, 0.9, 40))
    xyz = np.stack([np.full(y.size, 5.0), y.ravel(), z.ravel(), np.ones(y.size)], axis=-1).astype("<f4")
    xyz = np.vstack([xyz, [(-5, 0, 0, 1)], [(6, 0.5, 0, 1)]]).astype("<f4")  # behind; and behind the plane
    ids = np.where(xyz[:, 1] > 0, 3, 17).astype("<u4")
    ids[-1] = 4
    for i in range(scans):
        image = np.full((1200, 1920, 3), (10, 20, 30), np.uint8)
        save(folder / "pylon_camera_node" / f"frame{i:06d}-1581624663_{100 + i}.jpg", image)
        for part, array in (("os1_cloud_node_kitti_bin/{:06d}.bin", xyz),
                            ("os1_cloud_node_semantickitti_label_id/{:06d}.label", ids)):  # fmt: skip
            file = folder / part.format(i)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(array.tobytes())
    shift = [[1, 0, 0, 0.5 * i, 0, 1, 0, 0, 0, 0, 1, 0] for i in range(scans)]
    np.savetxt(folder / "poses.txt", np.array(shift, float))
    (folder / "camera_info.txt").write_text("2813.643275 2808.326079 969.285772 624.049972\n")
    (folder / "transforms.yaml").write_text(  # optical axes in the lidar's, 0.1 m ahead of it
        "os1_cloud_node-pylon_camera_node:\n  q: {w: 0.5, x: -0.5, y: 0.5, z: -0.5}\n"
        "  t: {x: 0.1, y: 0.0, z: 0.0}\n"
    )
    return xyz


def test_rellis_points_are_where_opencv_projects_them(tmp_path: Path) -> None:
    xyz = write_rellis(tmp_path)
    found = check_source(opened(tmp_path))
    assert [f.stamp_ns for f in found] == [1_581_624_663_100_000_000 + i * 1_000_000 for i in range(3)]
    frame = found[1]
    assert frame.labels is not None
    assert (frame.intrinsics.width, frame.intrinsics.height) == (480, 300)
    assert frame.T_map_camera is not None
    np.testing.assert_allclose(frame.T_map_camera.position_m, (0.6, 0, 0))
    np.testing.assert_allclose(frame.T_map_camera.matrix[:3, 2], (1, 0, 0), atol=1e-9)  # looks ahead
    K = np.array([[2813.643275, 0, 969.285772], [0, 2808.326079, 624.049972], [0, 0, 1]])
    plane = xyz[:-2, :3]
    in_camera = np.stack([-plane[:, 1], -plane[:, 2], plane[:, 0] - 0.1], axis=-1).astype(float)
    pixels, _ = cv2.projectPoints(in_camera, np.zeros(3), np.zeros(3), K, None)
    # the centre of a large pixel lies between four small ones
    u, v = np.rint((pixels[:, 0] + 0.5) / 4 - 0.5).astype(int).T
    inside = (u >= 0) & (u < 480) & (v >= 0) & (v < 300)
    np.testing.assert_allclose(frame.depth[v[inside], u[inside]], 4.9, atol=1e-5)
    want = np.where(plane[inside, 1] > 0, 1, 2)
    np.testing.assert_array_equal(frame.labels[v[inside], u[inside]], want)
    assert (frame.depth > 0).sum() == len({*zip(u[inside], v[inside], strict=True)}) + 1  # and the far point
    assert (frame.labels[frame.depth == 0] == 255).all()


def test_rellis_without_a_part_is_counted_or_refused(tmp_path: Path) -> None:
    write_rellis(tmp_path)
    (tmp_path / "os1_cloud_node_kitti_bin/000000.bin").unlink()
    (tmp_path / "os1_cloud_node_semantickitti_label_id/000001.label").unlink()
    source = opened(tmp_path)()
    assert len(list(source)) == 1
    assert source.skipped == {"no scan": 1, "scan without labels": 1}
    (tmp_path / "transforms.yaml").write_text("os1: {}\n")
    with pytest.raises(InputError, match=r"transforms\.yaml: expected os1_cloud_node-pylon"):
        opened(tmp_path)()
    (tmp_path / "camera_info.txt").unlink()
    with pytest.raises(InputError, match=r"camera_info\.txt there or one folder higher"):
        opened(tmp_path)()
