"""Maps and costmaps as PGM + YAML that Nav2's map_server reads, and that read back here without loss.

What is written differs from Nav2's map_saver in two things. Unknown is grey 128 in place of 205: with 205,
p = 0.196, unknown becomes free in every loader whose free_thresh is 0.25 (navigation2#5138); 128, p = 0.498,
is unknown under any threshold in use. And numbers keep all their digits.

Map: grass 254, unknown 128, obstacle 0, person 1; a person is occupied for map_server, and the key
`swardmap: person` tells this module which grey is a person. map_server ignores keys it does not know.
Costmap: in mode raw, the values -1..100 that Nav2 publishes for these costs, and beside it a second PGM with
the costs themselves.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError, InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.door import through_door
from swardmap.io.files import inside, read_bytes, write_together
from swardmap.io.maps.map_images import GreyImage, decode_grey, encode_pgm
from swardmap.io.maps.map_yaml import MapDescription, description_text, nav_value_of_grey, read_description
from swardmap.labels import MapClass
from swardmap.mapping.costmap import Costmap, occupancy_from_costs

UNKNOWN_GREY = 128
PERSON_GREY = 1
GREY_OF_CLASS = np.array([UNKNOWN_GREY, 254, 0, PERSON_GREY], np.uint8)


def write_map(grid: OccupancyGrid, path: str | Path) -> Path:
    """Write `path`.pgm and `path`.yaml; a suffix .yaml or .pgm of `path` is taken off first.

    Returns:
        The YAML file.

    Raises:
        OutputError: if they cannot be written; an earlier map stays as it was.
    """
    stem = _stem(path)
    image, head = stem.with_name(stem.name + ".pgm"), stem.with_name(stem.name + ".yaml")
    grey = GREY_OF_CLASS[_checked_classes(grid.classes)]
    text = description_text(image.name, "trinary", grid.spec, grid.stamp_ns, {"person": PERSON_GREY})
    write_together({image: encode_pgm(grey[::-1]), head: text.encode()})
    return head


def write_costmap(costmap: Costmap, path: str | Path) -> Path:
    """Write `path`.pgm as Nav2 reads it, `path`_costs.pgm with nothing lost, and `path`.yaml.

    For graded costs Nav2's static layer needs `trinary_costmap: false`; otherwise it reads what is below
    inscribed as free.

    Returns:
        The YAML file.
    """
    stem = _stem(path)
    image, head = stem.with_name(stem.name + ".pgm"), stem.with_name(stem.name + ".yaml")
    costs = stem.with_name(stem.name + "_costs.pgm")
    values = occupancy_from_costs(costmap.costs)
    # raw reads every level above 100 as unknown; this one is unknown for loaders without raw, too
    grey = np.where(values < 0, np.int16(UNKNOWN_GREY), values).astype(np.uint8)
    text = description_text(image.name, "raw", costmap.spec, costmap.stamp_ns, {"costs": costs.name})
    pixels = {image: encode_pgm(grey[::-1]), costs: encode_pgm(costmap.costs[::-1])}
    write_together({**pixels, head: text.encode()})
    return head


@through_door("a map")
def read_map(path: str | Path, ignore_yaw: bool = False) -> OccupancyGrid:
    """Read a map: ours with every class, any other of map_server's as unknown, grass and obstacle.

    Values between free and occupied, which modes scale and raw may hold, become unknown: nobody knows
    that they are free.

    Args:
        path: the YAML file.
        ignore_yaw: take a rotated origin as if it were not, as Nav2's costmap does.

    Raises:
        InputError: see `read_nav_values`.
    """
    description = read_description(path)
    spec, values, grey = _read_values(description, Path(path), ignore_yaw)
    classes = np.full(spec.shape, MapClass.UNKNOWN, np.uint8)
    classes[values == 0] = MapClass.GRASS
    classes[values == 100] = MapClass.OBSTACLE
    person = description.extra.get("person")
    if person is not None:
        classes[(values == 100) & (grey == person)] = MapClass.PERSON
    return OccupancyGrid(spec, classes, _stamp_ns(description, path))


@through_door("a map")
def read_nav_values(path: str | Path, ignore_yaw: bool = False) -> tuple[GridSpec, NDArray[np.int8]]:
    """Read a map exactly as map_server does: nav_msgs values -1..100, row 0 at the bottom.

    Raises:
        InputError: if a file is missing or damaged, a key is missing or out of range, free_thresh is not
            below occupied_thresh, or the origin is rotated.
    """
    spec, values, _ = _read_values(read_description(path), Path(path), ignore_yaw)
    return spec, values


@through_door("a costmap")
def read_costmap(path: str | Path) -> Costmap:
    """Read a costmap that `write_costmap` wrote, with nothing lost.

    Raises:
        InputError: if it is another map, damaged, or its two images contradict each other.
    """
    description = read_description(path)
    spec, values, _ = _read_values(description, Path(path), ignore_yaw=False)
    name = description.extra.get("costs")
    if not isinstance(name, str):
        raise InputError(f"{path}: expected a costmap written by swardmap (key swardmap: costs), got a map")
    file = inside(Path(path).parent, name)
    grey, _ = decode_grey(read_bytes(file), str(file))
    if grey.shape != spec.shape:
        raise InputError(f"{file}: expected the size of {description.image}, {spec.shape}, got {grey.shape}")
    costs = np.ascontiguousarray(grey[::-1])
    if not np.array_equal(occupancy_from_costs(costs), values):
        raise InputError(f"{file} contradicts {description.image}: was one of them edited or replaced?")
    return Costmap(spec, costs, _stamp_ns(description, path))


def is_costmap(path: str | Path) -> bool:
    """Whether a YAML file describes a costmap of ours."""
    return "costs" in read_description(path).extra


def _read_values(
    description: MapDescription, path: Path, ignore_yaw: bool
) -> tuple[GridSpec, NDArray[np.int8], NDArray[np.uint8]]:
    """Grid, map_server's values and grey levels, row 0 at the bottom."""
    x, y, yaw = description.origin
    if yaw != 0 and not ignore_yaw:
        raise InputError(
            f"{path}: the origin is turned by {yaw:g} rad; swardmap's grids (and Nav2's costmaps) are not "
            "turned: turn the image, or pass ignore_yaw to do as Nav2 does"
        )
    grey, opacity = _flipped(decode_grey(read_bytes(description.image), str(description.image)))
    try:
        frame_id = str(description.extra.get("frame_id", "map"))
        spec = GridSpec(description.resolution_m, grey.shape[1], grey.shape[0], (x, y), frame_id)
    except InvalidValueError as error:
        raise InputError(f"{path}: {error}") from error
    table = nav_value_of_grey(
        description.mode, description.negate, description.free_thresh, description.occupied_thresh
    )
    values = table[grey]
    if opacity is not None and description.mode != "raw":
        values[opacity < 255] = -1
    return spec, values, grey


def _flipped(image: GreyImage) -> GreyImage:
    grey, opacity = image
    return np.ascontiguousarray(grey[::-1]), None if opacity is None else opacity[::-1]


def _stem(path: str | Path) -> Path:
    path = Path(path)
    return path.with_suffix("") if path.suffix.lower() in (".yaml", ".yml", ".pgm") else path


def _checked_classes(classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if classes.size and classes.max() >= len(GREY_OF_CLASS):
        raise InvalidValueError(f"map: expected classes 0..{len(GREY_OF_CLASS) - 1}, got {classes.max()}")
    return classes


def _stamp_ns(description: MapDescription, path: str | Path) -> int:
    stamp = description.extra.get("stamp_ns", 0)
    if not isinstance(stamp, int):
        raise InputError(f"{path}: expected 'stamp_ns' to be a whole number, got {stamp!r}")
    return stamp
