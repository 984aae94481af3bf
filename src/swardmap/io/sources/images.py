"""Images by pattern: for data that no other kind of source fits.

    swardmap map ROOT -o out/ --format images --set "source.color_files=a/*.jpg"
        --set "source.depth_files=b/*.png" --set source.intrinsics=[525,525,319.5,239.5]
        --set source.poses_file=poses.txt

Which depth image belongs to which colour image is told by the numbers in their names, or, where those do not
agree, by `pair_by`. Poses are those of the optical frame in a map whose z is up: with times in seconds, as
the TUM benchmark writes them, where the names are times; without, one for each colour image in their order.
"""

import re
from pathlib import Path

from swardmap.config import SourceConfig
from swardmap.errors import ConfigError, InputError
from swardmap.geometry import Pose
from swardmap.io.files import inside
from swardmap.io.sources.listed import Listed, listed_source
from swardmap.io.sources.pairing import COLOR, DEPTH, Pair, Pairer
from swardmap.io.sources.source import Source
from swardmap.io.sources.trajectory import Trajectory, read_trajectory

NUMBERS = re.compile(r"\d+")
TIME = re.compile(r"[1-9]\d{8,18}(?:\.\d+)?")
DIGITS_TO_NS = ((17, 1), (14, 1_000), (11, 1_000_000), (0, 1_000_000_000))
"""Digits of a time in whole numbers -> its unit in nanoseconds: ns, us, ms, s since 1970."""
PERIOD_NS = 100_000_000
DEPTH_UNIT_M = 0.001


def recognises(_: Path) -> bool:
    """Never by itself: the patterns must be said."""
    return False


def open_source(path: Path, config: SourceConfig) -> Source:
    """Open the images that the settings name.

    Raises:
        ConfigError: if a pattern or the camera is not said.
        InputError: if no file fits, or it is not certain what belongs together.
    """
    if config.color_files is None or config.depth_files is None:
        raise ConfigError(
            "images by pattern: expected source.color_files and source.depth_files (--rgb and --depth), such "
            "as 'depth/*.png'"
        )
    if config.intrinsics is None:
        raise ConfigError("images by pattern: the camera is not said: --set source.intrinsics=[fx,fy,cx,cy]")
    colors, depths = (_files(path, pattern) for pattern in (config.color_files, config.depth_files))
    pairs = _paired(path, colors, depths, config)
    poses = None if config.poses_file is None else read_trajectory(inside(path, config.poses_file))
    if poses is not None and poses.stamps_ns is None and len(poses.poses) != len(colors):
        raise InputError(
            f"{path / str(config.poses_file)}: expected one pose for each of {len(colors)} colour images, "
            f"got {len(poses.poses)}"
        )
    order = {file: i for i, file in enumerate(colors)}
    frames = [_listed(color, depth, order[color], poses, config) for color, depth in pairs]
    return listed_source(path, frames, config.intrinsics, DEPTH_UNIT_M, config)


def stamp_in_name(file: Path) -> int | None:
    """Nanoseconds of a name that is a time since 1970, in s, ms, us or ns; None if it is none.

    >>> stamp_in_name(Path("1305031102.175304.png")), stamp_in_name(Path("left_1700000000123.jpg"))
    (1305031102175304000, 1700000000123000000)
    """
    found = TIME.search(file.stem)
    if found is None:
        return None
    whole, _, part = found[0].partition(".")
    if part and len(whole) > 10:
        return None
    unit = next(unit for digits, unit in DIGITS_TO_NS if len(whole) >= digits)
    return int(whole) * unit + (int(part.ljust(9, "0")[:9]) if part else 0)


def _files(path: Path, pattern: str) -> list[Path]:
    inside(path, pattern.replace("*", "x"))
    found = [file for file in path.glob(pattern) if file.is_file()]
    if not found:
        raise InputError(f"{path}: no file fits '{pattern}'")
    return sorted(found, key=lambda file: ([int(n) for n in NUMBERS.findall(file.stem)], file.name))


def _paired(
    path: Path, colors: list[Path], depths: list[Path], config: SourceConfig
) -> list[tuple[Path, Path | None]]:
    if config.pair_by == "order":
        if len(colors) != len(depths):
            raise InputError(
                f"{path}: expected as many depth as colour images, got {len(depths)}, {len(colors)}"
            )
        return list(zip(colors, depths, strict=True))
    if config.pair_by == "time":
        return _by_time(path, colors, depths, config)
    keys = [{tuple(int(n) for n in NUMBERS.findall(f.stem)): f for f in files} for files in (colors, depths)]
    by_color, by_depth = keys
    unique = len(by_color) == len(colors) and len(by_depth) == len(depths) and () not in by_color
    common = by_color.keys() & by_depth.keys()
    if not unique or (config.pair_by is None and 2 * len(common) < max(len(by_color), len(by_depth))):
        raise InputError(
            f"{path}: the numbers in the names do not say which depth image belongs to {colors[0].name} "
            f"(the first is {depths[0].name}): set source.pair_by to name, time or order"
        )
    return [(color, by_depth.get(key)) for key, color in by_color.items()]


def _by_time(
    path: Path, colors: list[Path], depths: list[Path], config: SourceConfig
) -> list[tuple[Path, Path | None]]:
    """Neighbours in time."""
    stamped = [
        (stamp_in_name(file), kind, file)
        for kind, files in ((COLOR, colors), (DEPTH, depths))
        for file in files
    ]
    without = next((file for stamp_ns, _, file in stamped if stamp_ns is None), None)
    if without is not None:
        raise InputError(f"{path}: expected names that are times since 1970, got {without.name}")
    pairer = Pairer[Path](round(config.pair_tolerance_ms * 1e6))
    found: list[Pair[Path]] = []
    for stamp_ns, kind, file in sorted(stamped, key=lambda image: (image[0] or 0, image[1])):
        found += pairer.add(kind, stamp_ns or 0, file)
    found += pairer.flush()
    depth_of = {pair.color: pair.depth for pair in found}
    return [(color, depth_of.get(color)) for color in colors]


def _listed(
    color: Path, depth: Path | None, number: int, poses: Trajectory | None, config: SourceConfig
) -> Listed:
    stamp_ns, pose, fault = stamp_in_name(color), None, ""
    if poses is not None and poses.stamps_ns is not None:
        if stamp_ns is None:
            raise InputError(
                f"{color}: the poses have times, but the name is none: give poses without a time, one "
                "for each colour image, or images named by their times"
            )
        pose = poses.at(stamp_ns, round(config.pose_tolerance_ms * 1e6))
        fault = "" if pose else "no pose near in time"
    elif poses is not None:
        pose = _of(poses, number)
    return Listed(color.stem, number * PERIOD_NS if stamp_ns is None else stamp_ns, color, depth, pose, fault)


def _of(poses: Trajectory, number: int) -> Pose:
    return poses.poses[number]
