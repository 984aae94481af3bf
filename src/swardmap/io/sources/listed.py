"""Frames of a list of image files: what most data sets come down to once their folders are understood."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.config import SourceConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.images import DepthImage, read_color, read_depth
from swardmap.io.sources.source import Source, Tally
from swardmap.types import Frame

Focal = tuple[float, float, float, float]
"""fx, fy, cx, cy in pixels."""

Pair = tuple[NDArray[np.uint8], DepthImage]
"""Colour (H, W, 3) and depth (H, W)."""


ADVICE = "set source.intrinsics=[fx,fy,cx,cy] of this image size"


@dataclass(frozen=True, slots=True)
class Listed:
    """One frame by its files.

    Attributes:
        name: a word.
        stamp_ns: its time.
        color, depth: the files; None if there is none.
        T_map_camera: pose of the optical frame; None = the recording has no poses.
        fault: why the frame cannot be used, though its files are there.
    """

    name: str
    stamp_ns: int
    color: Path | None
    depth: Path | None
    T_map_camera: Pose | None = None
    fault: str = ""


def read_pair(color: Path, depth: Path) -> Pair:
    """Both images as they are in the files."""
    return read_color(color), read_depth(depth)


def listed_source(
    path: Path,
    frames: Sequence[Listed],
    focal: Focal,
    depth_unit_m: float,
    config: SourceConfig,
    read: Callable[[Path, Path], Pair] = read_pair,
) -> Source:
    """A source of the frames of a list that are chosen by `start`, `stop` and `every`.

    Args:
        path: of the data set.
        frames: in order of time.
        focal: fx, fy, cx, cy of the images that `read` gives.
        depth_unit_m: of 16-bit depth, unless configured.
        config: what to choose; its unit counts.
        read: both images of a frame, of one size.

    Raises:
        InputError: if there is no frame.
    """
    if not frames:
        raise InputError(f"{path}: expected at least one frame, found none")
    chosen = frames[config.start : config.stop : config.every]
    unit_m = config.depth_unit_m or depth_unit_m
    return Source(path.resolve().name, len(chosen), None, partial(_frames, chosen, focal, unit_m, read))


def _frames(
    chosen: Sequence[Listed],
    focal: Focal,
    unit_m: float,
    read: Callable[[Path, Path], Pair],
    tally: Tally,
) -> Iterator[Frame]:
    for entry in chosen:
        if entry.color is None or entry.depth is None or entry.fault:
            part = "no colour image" if entry.color is None else "no depth image"
            reason = entry.fault or part
            tally.skip(reason, f"frame {entry.name}: {reason}")
            continue
        yield _frame(entry, *read(entry.color, entry.depth), focal, unit_m)


def _frame(entry: Listed, rgb: NDArray[np.uint8], depth: DepthImage, focal: Focal, unit_m: float) -> Frame:
    height, width = depth.shape
    try:
        camera = Intrinsics(width, height, *focal).centered(ADVICE)
        # floats are metres
        unit = unit_m if depth.dtype == np.uint16 else 1.0
        return Frame(entry.stamp_ns, camera, rgb, depth, unit, entry.T_map_camera, name=entry.name)
    except InvalidValueError as error:
        raise InputError(f"{entry.depth}: {error}") from error
