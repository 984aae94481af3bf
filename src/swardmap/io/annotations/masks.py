"""Masks from annotation tools, one at a time, in the classes of one label set."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError, InvalidValueError
from swardmap.grid import MAX_CELLS
from swardmap.io.door import reading, through_door
from swardmap.io.files import inside, read_bytes
from swardmap.labels import VOID_ID, LabelSet, Role

Mask = NDArray[np.uint8]
BACKGROUND = "background"
"""What the tools call pixels that nobody annotated; void unless the caller says otherwise."""

PAINT_ORDER = (Role.VOID, Role.FREE, Role.OBSTACLE, Role.PERSON)
"""Where annotations overlap and the tool gives no order: an obstacle beats grass, a person beats both."""


class Masks(Mapping[str, Mask]):
    """Masks by name; each is read when it is asked for.

    Args:
        label_set: what the ids mean.
        readers: name -> function that reads the mask, (H, W) uint8.
    """

    def __init__(self, label_set: LabelSet, readers: Mapping[str, Callable[[], Mask]]) -> None:
        self.label_set = label_set
        self._readers = dict(readers)

    def __getitem__(self, name: str) -> Mask:
        """The mask of one image, (H, W) uint8 ids of `label_set`."""
        reader = self._readers[name]
        with reading(name, "a mask"):
            return reader()

    def __iter__(self) -> Iterator[str]:
        return iter(self._readers)

    def __len__(self) -> int:
        return len(self._readers)


def ids_by_name(
    names: Iterable[str], target: LabelSet, classes: Mapping[str, str] | None, where: str
) -> dict[str, int]:
    """Ids in `target` of the names a tool uses.

    Args:
        names: all names of the annotation file.
        target: the set to express masks in.
        classes: name there -> name in `target`, or "void"; `*` stands for all that mean nothing else.
            Without an entry a name stands for itself, and background for void.
        where: the file, for messages.

    Raises:
        InputError: if a name means nothing in `target`: it might be an obstacle.
    """
    wanted = {BACKGROUND: "void", **dict(classes or {})}
    known = {c.name: c.id for c in target.classes} | {"void": VOID_ID}
    for name in wanted.values():
        if name not in known:
            raise InvalidValueError(f"no class '{name}'; known: {', '.join(known)}")
    rest = wanted.get("*")
    meant = {n: wanted.get(n, n if n in known or rest is None else rest) for n in names}
    strange = [name for name, meaning in meant.items() if meaning not in known]
    if strange:
        raise InputError(
            f"{where}: nobody says what these classes are: {', '.join(map(repr, strange[:12]))}. "
            f"Name each as one of {', '.join(known)}, such as --class '{strange[0]}=void'"
        )
    return {name: known[meaning] for name, meaning in meant.items()}


def add_reader(
    readers: dict[str, Callable[[], Mask]], image: str, read: Callable[[], Mask], where: str
) -> None:
    """Enter a mask under the name of its image without the suffix.

    Raises:
        InputError: if the name leads out of a folder, or is there already.
    """
    name = inside(Path(), image.lstrip("/")).with_suffix("").as_posix()
    if name in readers:
        raise InputError(f"{where}: expected each image once, got '{name}' twice")
    readers[name] = read


def by_gravity(ids: Sequence[int], label_set: LabelSet) -> list[int]:
    """Order in which to paint annotations with these ids: the gravest last, else as given."""
    gravity = {c.id: PAINT_ORDER.index(c.role) for c in label_set.classes}
    return sorted(range(len(ids)), key=lambda i: gravity.get(ids[i], 0))


def blank_mask(height: int, width: int, value: int, where: str) -> Mask:
    """A mask of one class, refused if no image can be that large."""
    if not (height > 0 and width > 0 and height * width <= MAX_CELLS):
        raise InputError(f"{where}: expected an image of 1 to {MAX_CELLS} pixels, got {width} x {height}")
    return np.full((height, width), value, np.uint8)


def fill_polygon(mask: Mask, corners: NDArray[np.float64], value: int) -> None:
    """Set the pixels whose centres (+0.5) lie inside a polygon, by the even-odd rule.

    Args:
        mask: (H, W), changed in place.
        corners: (N, 2) x and y in pixels; 0 is the outer edge of the first pixel.
        value: to set.
    """
    x, y = corners[:, 0], corners[:, 1]
    first = max(0, int(np.floor(y.min() - 0.5)))
    last = min(mask.shape[0], int(np.ceil(y.max() + 0.5)))
    columns = np.arange(mask.shape[1]) + 0.5
    for row in range(first, last):
        level = row + 0.5
        crosses = (y > level) != (np.roll(y, -1) > level)
        if crosses.any():
            x0, y0, x1, y1 = x[crosses], y[crosses], np.roll(x, -1)[crosses], np.roll(y, -1)[crosses]
            at = np.sort(x0 + (level - y0) / (y1 - y0) * (x1 - x0))
            inside = np.searchsorted(at, columns) % 2 == 1
            mask[row, inside] = value


def runs_to_flat(runs: Sequence[int] | NDArray[np.int64], size: int, where: str) -> NDArray[np.bool_]:
    """Run lengths, background first, as (size,) bool; what is left at the end is background.

    >>> runs_to_flat([1, 2], 4, "").tolist()
    [False, True, True, False]
    """
    lengths = np.asarray(runs, np.int64)
    if lengths.ndim != 1 or (lengths < 0).any() or (lengths > size).any() or lengths.sum() > size:
        raise InputError(f"{where}: damaged run lengths: expected {size} pixels in all")
    values = np.arange(len(lengths)) % 2 == 1
    flat = np.zeros(size, bool)
    flat[: lengths.sum()] = np.repeat(values, lengths)
    return flat


def colors_to_ids(image: NDArray[np.uint8], ids: Mapping[tuple[int, int, int], int], where: str) -> Mask:
    """A mask (H, W) from an RGB image whose colours mean classes; every colour must be one of them."""
    packed = image.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    codes = np.array([r << 16 | g << 8 | b for r, g, b in ids], np.uint32)
    order = np.argsort(codes)
    place = np.minimum(np.searchsorted(codes[order], packed), len(codes) - 1)
    wrong = codes[order][place] != packed
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise InputError(
            f"{where}: colour {tuple(image[row, column].tolist())} at ({column}, {row}) is no class's "
            f"({int(wrong.sum())} such pixels): was the image scaled or saved as JPEG?"
        )
    table: Mask = np.array(list(ids.values()), np.uint8)[order]
    mask: Mask = table[place]
    return mask


@through_door("a mask")
def read_mask_image(path: Path) -> NDArray[np.uint8]:
    """A PNG or BMP as (H, W) indices or (H, W, 3) RGB, opacity left out.

    Raises:
        InputError: if it is damaged or of another kind.
    """
    import cv2

    from swardmap.io.maps.map_images import check_image

    content = read_bytes(path)
    check_image(content, str(path))
    image: Any = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint8:
        raise InputError(f"{path}: expected an image of 8 bits")
    if image.ndim == 2 or image.shape[2] == 1:
        return np.asarray(image.reshape(image.shape[:2]), np.uint8)
    if image.shape[2] < 3:
        raise InputError(f"{path}: expected one or three channels, got {image.shape[2]}")
    return np.ascontiguousarray(image[..., 2::-1])
