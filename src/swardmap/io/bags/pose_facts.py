"""How the poses of a recording or of a run of the node were found, for summary.json and a person's eye."""

from collections.abc import Iterable
from typing import Any

from swardmap.io.bags.tf import TransformBuffer


def pose_facts(
    buffer: TransformBuffer,
    frames: tuple[str, str],
    origin: str,
    topics: Iterable[str],
    tolerance_ns: int,
) -> dict[str, Any]:
    """Frames, topics and largest gaps on the way from the map to a camera.

    Args:
        buffer: that the poses were looked up in.
        frames: of the map and of the camera.
        origin: what the poses are from: tf, an odometry, ...
        topics: that were read.
        tolerance_ns: largest gap that is interpolated over.

    Raises:
        InputError: if the frames between them go round in a circle, or one has two parents.
    """
    way = buffer.way(*frames)
    return {
        "from": origin,
        "topics": sorted(topics),
        "frames": " <- ".join([*(p for p, _, _ in reversed(way)), frames[1]]),
        "static": [f"{p} <- {c}" for p, c, moves in way if not moves],
        "largest_gap_ms": {edge: round(ns / 1e6, 1) for edge, ns in buffer.gaps_ns(*frames).items()},
        "tolerance_ms": tolerance_ns / 1e6,
    }
