"""What every frame source must keep: put yours through `check_source` (CONTRIBUTING.md)."""

from collections.abc import Callable

import numpy as np

from swardmap.io import FrameSource
from swardmap.types import Frame


def check_source(make: Callable[[], FrameSource]) -> list[Frame]:
    """Iterate a source twice and check what a user relies on; returns its frames."""
    source = make()
    assert isinstance(source, FrameSource)
    assert source.name
    frames, again = list(source), list(source)
    left_out = sum(source.skipped.values())
    assert frames, "a source for this test must yield something"
    if source.frame_count is not None:
        assert len(frames) <= source.frame_count <= len(frames) + left_out
    stamps = [frame.stamp_ns for frame in frames]
    assert stamps == sorted(stamps)
    assert len({frame.name for frame in frames}) == len(frames)
    for one, two in zip(frames, again, strict=True):
        _check_same(one, two)
    if source.label_set is not None:
        assert any(frame.labels is not None for frame in frames)
    return frames


def _check_same(one: Frame, two: Frame) -> None:
    assert (one.stamp_ns, one.name, one.intrinsics) == (two.stamp_ns, two.name, two.intrinsics)
    np.testing.assert_array_equal(one.rgb, two.rgb)
    np.testing.assert_array_equal(one.depth, two.depth)
    assert (one.T_map_camera is None) == (two.T_map_camera is None)
    if one.T_map_camera is not None and two.T_map_camera is not None:
        np.testing.assert_array_equal(one.T_map_camera.matrix, two.T_map_camera.matrix)
