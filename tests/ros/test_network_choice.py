"""Which network a robot's rig is given: the larger one wherever the cores carry it."""

from dataclasses import replace

import pytest

from swardmap.config import MountConfig, SegmenterConfig
from swardmap.models import bundled_network
from swardmap.rig.rig import Rig, RigCamera
from swardmap.ros.network_choice import frames_asked_s, network_of_rig


def rig_of(*rates_hz: float | None, backward: int = 0) -> Rig:
    """Cameras that look ahead at these rates; the last `backward` of them look back."""
    ahead = len(rates_hz) - backward
    return Rig(
        tuple(
            RigCamera(
                f"camera{i}",
                "forward" if i < ahead else "backward",
                MountConfig(height_m=0.6, pitch_deg=25.0, yaw_deg=0.0 if i < ahead else 180.0),
                rate_hz=rate_hz,
            )
            for i, rate_hz in enumerate(rates_hz)
        )
    )


def test_frames_of_cameras_that_look_one_way_are_asked_for_together() -> None:
    assert frames_asked_s(rig_of(15, 10)) == 25
    assert frames_asked_s(rig_of(15, None)) == 30  # what a camera usually gives
    assert frames_asked_s(rig_of(10, 5, 20, backward=1)) == 20
    assert frames_asked_s(rig_of(10, 5, 12, backward=1)) == 15


@pytest.mark.parametrize(
    ("rig", "cores", "name"),
    [
        (rig_of(15, 15), 2, "small"),
        (rig_of(None, None), 2, "small"),
        (rig_of(15, 15), 3, "auto"),
        (rig_of(10, 10), 2, "auto"),
        (rig_of(10, 10), 1, "small"),
        (rig_of(15, 15, backward=1), 2, "auto"),  # one at a time
        (rig_of(15, 15, 15, 15, backward=2), 2, "small"),
        (rig_of(30), 2, "auto"),  # frames of one camera that are too many lose nothing
        (None, 1, "auto"),
    ],
)
def test_the_smaller_one_is_for_rigs_that_ask_more_than_the_cores_map(
    rig: Rig | None, cores: int, name: str
) -> None:
    found, why = network_of_rig(SegmenterConfig(), rig, cores)
    assert found == name
    assert bool(why) == (name == "small")
    assert not why or "segmenter.name: large" in why


@pytest.mark.parametrize("name", ["large", "small", "colour", "my-lawn.onnx"])
def test_a_network_that_was_named_is_kept(name: str) -> None:
    assert network_of_rig(SegmenterConfig(name=name), rig_of(15, 15), 2) == (name, "")


def test_a_gpu_is_not_counted_by_cores() -> None:
    config = replace(SegmenterConfig(), provider="CUDAExecutionProvider")
    assert network_of_rig(config, rig_of(15, 15), 2) == ("auto", "")


def test_large_is_what_auto_means_elsewhere() -> None:
    assert bundled_network("large") == bundled_network("auto") != bundled_network("small")
