"""Which network of the package `auto` means on a robot: the smaller one where cores are few."""

from swardmap.config import SegmenterConfig
from swardmap.models.onnx import CPU_PROVIDER
from swardmap.rig.rig import Rig

FRAMES_A_CORE_S = 10.0
"""What a core maps with the larger network beside all else: two map 23 a second, or 30 (docs/robot.md)."""

USUAL_RATE_HZ = 15.0
"""Of a camera for which the rig file gives no `rate_hz`."""


def frames_asked_s(rig: Rig) -> float:
    """Frames a second of all cameras that are processed together, in the direction where they are most."""
    asked = {"forward": 0.0, "backward": 0.0}
    for camera in rig.cameras:
        asked[camera.direction] += camera.rate_hz or USUAL_RATE_HZ
    return max(asked.values())


def network_of_rig(config: SegmenterConfig, rig: Rig | None, cores: int) -> tuple[str, str]:
    """The name of the segmenter for a rig, and a line that says why; empty where it is the one configured.

    Args:
        config: only `auto` on the CPU is ever replaced.
        rig: None for a single camera, whose frames that are too many may as well be dropped.
        cores: that the process may use.
    """
    asked_s = 0.0 if rig is None or len(rig.cameras) < 2 else frames_asked_s(rig)
    most_s = FRAMES_A_CORE_S * cores
    if config.name != "auto" or config.provider != CPU_PROVIDER or asked_s <= most_s:
        return config.name, ""
    return "small", (
        f"the rig's cameras give {asked_s:g} frames/s together, more than the {most_s:g} that the larger "
        f"network maps on {cores} core{'s' * (cores > 1)}: the smaller one is used, which knows less of lawn "
        "in deep shade and of persons far away; segmenter.name: large keeps the larger one"
    )
