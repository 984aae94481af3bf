"""The rig file and the mounts in it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from swardmap.errors import ConfigError, InvalidValueError
from swardmap.geometry import mount_pose
from swardmap.rig.rig import Direction, Rig, RigCamera, read_rig, rig_from_dict

MOUNT = {"x_m": 0.6, "y_m": 0.25, "height_m": 0.9, "pitch_deg": 25.0}


def tree(**changes: Any) -> dict[str, Any]:
    """The paper's mower: two cameras at the front, two at the rear."""
    cameras: dict[str, Any] = {
        "front_left": {"mount": {**MOUNT, "yaw_deg": 15}, "serial": "012345"},
        "front_right": {"mount": {**MOUNT, "y_m": -0.25, "yaw_deg": -15}},
        "rear_left": {"direction": "backward", "mount": {**MOUNT, "x_m": -0.6, "yaw_deg": 165}},
        "rear_right": {"direction": "backward", "mount": {**MOUNT, "x_m": -0.6, "yaw_deg": -165}},
    }
    for name, section in changes.items():
        cameras[name] = {**cameras.get(name, {}), **section}
    return {"cameras": cameras}


def test_a_rig_file_names_cameras_in_its_order(tmp_path: Path) -> None:
    file = tmp_path / "rig.yaml"
    file.write_text(
        yaml.safe_dump({**tree(), "base_frame": "base_link", "direction": {"hold_s": 1.0}}, sort_keys=False)
    )
    rig = read_rig(file)
    assert rig.names == ("front_left", "front_right", "rear_left", "rear_right")
    assert rig["front_left"].serial == "012345"
    assert rig.selector.hold_s == 1.0
    assert [c.name for c in rig.facing(Direction.BACKWARD)] == ["rear_left", "rear_right"]
    pose = rig.T_base_camera("rear_left")
    assert (pose.parent, pose.child) == ("base_link", "rear_left")


def test_mounts_are_those_of_tape_and_level() -> None:
    rig = rig_from_dict(tree())
    expected = mount_pose(0.9, 25.0, 0.0, 15.0, (0.6, 0.25))
    np.testing.assert_array_equal(rig.T_base_camera("front_left").matrix, expected.matrix)
    for camera in rig.cameras:  # the optical axis points ahead or back, and down by the sine of the pitch
        axis = rig.T_base_camera(camera.name).matrix[:3, 2]
        assert np.sign(axis[0]) == (1 if camera.direction == "forward" else -1)
        assert axis[2] == pytest.approx(-np.sin(np.deg2rad(25)))
    left, right = (rig.T_base_camera(n).matrix[:3, 2] for n in ("rear_left", "rear_right"))
    assert left[1] > 0 > right[1]  # y is left, also for a camera that looks back


def test_intrinsics_are_optional() -> None:
    assert rig_from_dict(tree())["front_left"].intrinsics is None
    k = {"camera_matrix": {"fx": 460, "fy": 461, "cx": 319.5, "cy": 239.5}, "width": 640, "height": 480}
    intrinsics = rig_from_dict(tree(front_left=k))["front_left"].intrinsics
    assert intrinsics is not None
    np.testing.assert_array_equal(intrinsics.matrix, [[460, 0, 319.5], [0, 461, 239.5], [0, 0, 1]])


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        ({}, "cameras"),
        ([1], "cameras"),
        ({"cameras": {}}, "at least one camera"),
        ({"cameras": {"a": None}}, "cameras.a"),
        ({"cameras": {"a": {}}}, "mount.height_m"),
        ({**tree(), "camera": {}}, "unknown keys camera"),
        ({**tree(), "base_frame": ""}, "base_frame"),
        ({**tree(), "direction": {"hold": 1}}, "did you mean 'hold_s'"),
        (tree(front_left={"mount": {**MOUNT, "pich_deg": 3}}), "did you mean 'pitch_deg'"),
        (tree(front_left={"mount": {"height_m": 1.0}}), "mount.pitch_deg"),
        (tree(front_left={"serial": 12345}), "in quotes"),
        (tree(front_left={"width": 640}), "width and height together"),
        (tree(front_left={"camera_matrix": {"fx": 1, "fy": 1}}), "width and height beside"),
        (tree(front_left={"camera_matrix": {"cx": 1}, "width": 4, "height": 4}), "fx"),
        (tree(front_left={"direction": "left"}), "forward, backward"),
        (tree(front_left={"direction": "backward"}), "looks the other way"),
        (tree(rear_left={"direction": "forward"}), "looks the other way"),
        (tree(front_right={"serial": "012345"}), "each serial once"),
        (tree(front_right={"depth_topic": "/d"}, rear_left={"depth_topic": "/d"}), "each depth_topic once"),
    ],
)
def test_a_wrong_rig_gives_one_clear_error(broken: Any, words: str, tmp_path: Path) -> None:
    file = tmp_path / "rig.yaml"
    file.write_text(yaml.safe_dump(broken, sort_keys=False))
    with pytest.raises(ConfigError) as caught:
        read_rig(file)
    assert words in str(caught.value)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["a: [1", "!!python/object/apply:os.system ['true']", "\x00", "x" * 1_000_001]
)
def test_what_is_no_yaml_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"cannot read the rig|cameras"):
        read_rig(tmp_path / "rig.yaml")


def test_a_missing_file_and_an_unknown_name_are_named() -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.yaml"):
        read_rig("nowhere.yaml")
    with pytest.raises(InvalidValueError, match="front_left"):
        rig_from_dict(tree())["front"]


def test_a_rig_can_be_built_in_python() -> None:
    from swardmap.config import MountConfig

    camera = RigCamera("one", mount=MountConfig(height_m=1.0, pitch_deg=20.0))
    assert Rig((camera,)).facing(Direction.FORWARD) == (camera,)
    with pytest.raises(ConfigError, match="each name once"):
        Rig((camera, camera))
