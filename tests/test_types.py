"""Frames, masks and depth are checked when they are built."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.errors import InvalidValueError
from swardmap.geometry import Intrinsics
from swardmap.labels import GRASS_OBSTACLE_PERSON, VOID_ID
from swardmap.types import Frame, LabeledCloud, Segmentation, depth_in_metres, nearest_indices

K = Intrinsics(4, 3, 5.0, 5.0, 1.5, 1.0)


def frame(**changes: Any) -> Frame:
    fields: dict[str, Any] = {
        "stamp_ns": 1, "intrinsics": K,
        "rgb": np.zeros((3, 4, 3), np.uint8), "depth": np.ones((3, 4), np.uint16),
    }  # fmt: skip
    return Frame(**(fields | changes))


@pytest.mark.parametrize(
    ("changes", "match"),
    [({"rgb": np.zeros((3, 4), np.uint8)}, r"rgb: expected uint8 of shape \(3, 4, 3\)"),
     ({"rgb": np.zeros((3, 4, 3), np.float32)}, "rgb: expected uint8"),
     ({"depth": np.ones((4, 3), np.uint16)}, r"depth: .* of shape \(3, 4\)"),
     ({"depth": np.ones((3, 4), np.float64)}, "uint16 or float32"),
     ({"depth": [[1]]}, "got list"), ({"depth_unit_m": 0.0}, "positive depth unit"),
     ({"depth_unit_m": float("nan")}, "positive depth unit"),
     ({"depth_unit_m": 1000.0}, "0.001 for millimetres"), ({"depth_unit_m": 1e-50}, "0.001 for millimetres"),
     ({"labels": np.zeros((3, 4), np.uint8)}, "need a label_set"),
     ({"labels": np.zeros((3, 3), np.uint8), "label_set": GRASS_OBSTACLE_PERSON}, "labels: expected")],
)  # fmt: skip
def test_frames_that_do_not_hold_together_are_refused(changes: dict[str, Any], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        frame(**changes)


def test_every_kind_of_no_reading_becomes_nan() -> None:
    millimetres = np.array([[0, 1000, 65535]], np.uint16)
    np.testing.assert_allclose(depth_in_metres(millimetres, 0.001), [[np.nan, 1.0, 65.535]])
    metres = np.array([[0.0, -1.0, np.nan, np.inf, -np.inf, 1.5]], np.float32)
    np.testing.assert_array_equal(depth_in_metres(metres, 1.0), [[np.nan] * 5 + [1.5]])


def test_float_depth_is_in_metres_whatever_the_unit() -> None:
    assert frame(depth=np.ones((3, 4), np.float32), depth_unit_m=0.001).depth_m.max() == 1.0


@given(st.integers(1, 2000), st.integers(1, 2000))
def test_nearest_indices_are_the_floor_rule(n_out: int, n_in: int) -> None:
    indices = nearest_indices(n_out, n_in)
    assert indices[0] == 0
    assert indices[-1] == (n_out - 1) * n_in // n_out < n_in
    assert (np.diff(indices) >= 0).all()


def test_opencv_differs_from_the_rule_where_it_is_known_to() -> None:
    import cv2

    columns = np.arange(448, dtype=np.float32)[None, :]
    nearest = cv2.resize(columns, (640, 1), interpolation=cv2.INTER_NEAREST)[0]
    assert 0 < int((nearest != nearest_indices(640, 448)).sum()) < 20  # its float rounding


def test_masks_at_another_size_and_back() -> None:
    labels = np.arange(6, dtype=np.uint8).reshape(2, 3)
    mask = Segmentation(labels, GRASS_OBSTACLE_PERSON, np.full((2, 3), 0.5, np.float32))
    large = mask.resized_to(4, 6)
    np.testing.assert_array_equal(large.labels, np.repeat(np.repeat(labels, 2, axis=0), 2, axis=1))
    np.testing.assert_array_equal(large.resized_to(2, 3).labels, labels)
    assert mask.resized_to(2, 3) is mask


def test_what_is_not_sure_is_void_and_never_grass() -> None:
    confidence = np.array([[0.9, 0.5, 0.4, np.nan]], np.float32)
    mask = Segmentation(np.ones((1, 4), np.uint8), GRASS_OBSTACLE_PERSON, confidence)
    assert mask.confident(0.5).labels.tolist() == [[1, 1, VOID_ID, VOID_ID]]
    assert mask.confident(0.0).labels.tolist() == [[1, 1, 1, VOID_ID]]
    known = replace(mask, confidence=np.array([[0.9, 0.5, 0.4, 0.0]], np.float32))
    assert known.confident(0.0) is known
    assert replace(mask, confidence=None).confident(0.9).labels.tolist() == [[1, 1, 1, 1]]


def test_of_an_unfamiliar_image_no_grass_is_sure_and_every_obstacle_stays() -> None:
    confidence = np.array([[0.9, 0.9, 0.9]], np.float32)
    mask = Segmentation(np.array([[1, 0, 2]], np.uint8), GRASS_OBSTACLE_PERSON, confidence, unfamiliar=1.2)
    assert mask.confident(0.0, 1.0).labels.tolist() == [[VOID_ID, 0, 2]]
    assert replace(mask, confidence=None).confident(0.5, 1.0).labels.tolist() == [[VOID_ID, 0, 2]]
    assert mask.resized_to(2, 6).confident(0.0, 1.0).labels[:, :2].tolist() == [[VOID_ID] * 2] * 2
    assert mask.confident(0.0, 1.2) is mask  # as far as it may be
    assert mask.confident(0.0, None) is mask
    assert replace(mask, unfamiliar=None).confident(0.0, 0.0).labels.tolist() == [[1, 0, 2]]
    assert replace(mask, unfamiliar=np.inf).is_unfamiliar(1e9)


def test_grass_whose_confidence_is_no_number_is_never_sure_whatever_is_asked() -> None:
    confidence = np.array([[np.nan, 0.0, np.nan]], np.float32)
    mask = Segmentation(np.array([[1, 1, 0]], np.uint8), GRASS_OBSTACLE_PERSON, confidence)
    for threshold in (0.0, -1.0, 1e-9):
        assert mask.confident(threshold).labels[0, 0] == VOID_ID, threshold
        assert mask.confident(threshold).labels[0, 2] == 0, "doubt never takes an obstacle away"
    assert mask.confident(0.0).labels[0, 1] == 1
    assert replace(mask, confidence=np.zeros((1, 3), np.float32)).unsure(0.0) is None


def test_masks_and_clouds_are_checked() -> None:
    for strange in (np.nan, -0.1):
        with pytest.raises(InvalidValueError, match="expected unfamiliar of 0 or more"):
            Segmentation(np.zeros((2, 3), np.uint8), GRASS_OBSTACLE_PERSON, unfamiliar=strange)
    with pytest.raises(InvalidValueError, match=r"\(h, w\)"):
        Segmentation(np.zeros((0, 3), np.uint8), GRASS_OBSTACLE_PERSON)
    with pytest.raises(InvalidValueError, match="confidence"):
        Segmentation(np.zeros((2, 3), np.uint8), GRASS_OBSTACLE_PERSON, np.zeros((3, 2), np.float32))
    with pytest.raises(InvalidValueError, match="cloud: labels"):
        LabeledCloud(np.zeros((2, 3), np.float32), np.zeros(3, np.uint8), "map", GRASS_OBSTACLE_PERSON)


@pytest.mark.parametrize("matrix", [np.eye(4), np.eye(4, dtype=np.float32), np.eye(4).tolist()])
def test_a_matrix_is_taken_for_a_pose(flat_lawn: tuple[Frame, Segmentation], matrix: Any) -> None:
    frame = replace(flat_lawn[0], T_map_camera=matrix)
    assert frame.T_map_camera is not None
    assert (frame.T_map_camera.parent, frame.T_map_camera.child) == ("map", "camera")
    np.testing.assert_array_equal(frame.T_map_camera.matrix, np.eye(4))


@pytest.mark.parametrize(
    "matrix", [np.eye(3), 2 * np.eye(4), np.full((4, 4), np.nan), "map", 5, [[1, 2], [3]]]
)
def test_what_is_no_pose_is_refused_at_once(flat_lawn: tuple[Frame, Segmentation], matrix: Any) -> None:
    with pytest.raises(InvalidValueError, match="frame lawn: T_map_camera: expected a Pose"):
        replace(flat_lawn[0], T_map_camera=matrix)
