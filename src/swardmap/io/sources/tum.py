"""RGB-D sequences of the TUM benchmark, and what SLAM systems write in its layout.

    SEQUENCE/rgb.txt             lines: time in seconds, file
    SEQUENCE/depth.txt           the same; 16-bit images, 5000 units a metre, registered to the colour image
    SEQUENCE/groundtruth.txt     optional: time tx ty tz qx qy qz qw of the colour camera, at its own rate
    SEQUENCE/associations.txt    optional, in place of the first two: time colour time depth

https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats. The camera stands nowhere in the folder; its
authors recommend 525, 525, 319.5, 239.5 for all sequences, without undistortion. `intrinsics` overrides it.
The world is that of the motion capture, z up.
"""

from collections.abc import Iterator
from pathlib import Path

from swardmap.config import SourceConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.io.files import inside
from swardmap.io.sources.listed import Listed, listed_source
from swardmap.io.sources.pairing import COLOR, DEPTH, Pair, Pairer
from swardmap.io.sources.source import Source
from swardmap.io.sources.trajectory import Trajectory, read_trajectory, seconds_to_ns
from swardmap.io.text_lines import numbered_lines

COLOR_LIST, DEPTH_LIST, POSES_FILE = "rgb.txt", "depth.txt", "groundtruth.txt"
ASSOCIATIONS = ("associations.txt", "associate.txt", "associated.txt")
DEPTH_UNIT_M = 1 / 5000
KINECT = (525.0, 525.0, 319.5, 239.5)
MAX_IMAGES = 200_000
"""In a list: five hours, ten a second. All names of a sequence are held at once."""

Stamped = tuple[int, Path]


def recognises(path: Path) -> bool:
    """Whether `path` has the lists of such a sequence."""
    lists = (path / COLOR_LIST).is_file() and (path / DEPTH_LIST).is_file()
    return lists or _associations(path) is not None


def open_source(path: Path, config: SourceConfig) -> Source:
    """Open one sequence.

    Raises:
        InputError: if a list is missing or damaged, or no colour image has a depth image near in time.
    """
    pairs = list(_pairs(path, config))
    if not pairs:
        raise InputError(
            f"{path}: no colour image has a depth image within {config.pair_tolerance_ms:g} ms: "
            "set source.pair_tolerance_ms"
        )
    file = path / POSES_FILE
    poses = read_trajectory(file) if file.is_file() else None
    if poses is not None and poses.stamps_ns is None:
        raise InputError(f"{file}: expected a time before each pose")
    frames = [_listed(color, depth, poses, config) for color, depth in pairs]
    return listed_source(path, frames, config.intrinsics or KINECT, DEPTH_UNIT_M, config)


def _listed(color: Stamped, depth: Stamped, poses: Trajectory | None, config: SourceConfig) -> Listed:
    stamp_ns, file = color
    pose = None if poses is None else poses.at(stamp_ns, round(config.pose_tolerance_ms * 1e6))
    fault = "no pose near in time" if poses is not None and pose is None else ""
    there = [f if f.is_file() else None for f in (file, depth[1])]
    return Listed(file.stem, stamp_ns, there[0], there[1], pose, fault)


def _pairs(path: Path, config: SourceConfig) -> Iterator[tuple[Stamped, Stamped]]:
    """Colour and depth by the file that says so, else neighbours in time."""
    file = _associations(path)
    if file is not None:
        for number, words in numbered_lines(file, commas=True, most=MAX_IMAGES):
            if len(words) != 4:
                raise InputError(
                    f"{file}, line {number}: expected 'time colour time depth', got {len(words)} words"
                )
            yield _stamped(path, words[:2], file, number), _stamped(path, words[2:], file, number)
        return
    pairer = Pairer[Path](round(config.pair_tolerance_ms * 1e6))
    images = [(COLOR, *image) for image in _list(path, COLOR_LIST)]
    images += [(DEPTH, *image) for image in _list(path, DEPTH_LIST)]
    found: list[Pair[Path]] = []
    depth_ns = {image: stamp_ns for kind, stamp_ns, image in images if kind == DEPTH}
    for kind, stamp_ns, image in sorted(images, key=lambda i: (i[1], i[0])):
        found += pairer.add(kind, stamp_ns, image)
    for pair in [*found, *pairer.flush()]:
        yield (pair.stamp_ns, pair.color), (depth_ns[pair.depth], pair.depth)


def _list(path: Path, name: str) -> list[Stamped]:
    file = path / name
    images = []
    for number, words in numbered_lines(file, commas=True, most=MAX_IMAGES):
        if len(words) != 2:
            raise InputError(f"{file}, line {number}: expected 'time file', got {len(words)} words")
        images.append(_stamped(path, words, file, number))
    return sorted(images)


def _stamped(path: Path, words: list[str], file: Path, number: int) -> Stamped:
    try:
        return seconds_to_ns(words[0]), inside(path, words[1])
    except (InvalidValueError, InputError) as error:
        raise InputError(f"{file}, line {number}: {error}") from error


def _associations(path: Path) -> Path | None:
    return next((path / name for name in ASSOCIATIONS if (path / name).is_file()), None)
