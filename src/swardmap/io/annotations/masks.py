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
from swardmap.mapping.polygons import points_inside

Mask = NDArray[np.uint8]
BACKGROUND = "background"
"""What the tools call pixels that nobody annotated; void unless the caller says otherwise."""

OBSTACLE_WORDS = (
    "other obstacle tree trunk bush shrub hedge flower plant building house wall fence pole post bench chair "
    "table car vehicle bicycle animal dog cat stone rock water pond path road gravel asphalt soil dirt sky"
)
MEANINGS: Mapping[str, str] = {
    **dict.fromkeys("grass lawn turf mowngrass".split(), "grass"),  # noqa: SIM905 - words are read as words
    **dict.fromkeys("person people human man woman child pedestrian".split(), "person"),  # noqa: SIM905
    **dict.fromkeys(OBSTACLE_WORDS.split(), "other"),
    **dict.fromkeys("void ignore ignored unlabeled unlabelled unknown dontcare".split(), "void"),  # noqa: SIM905
}
"""Plain words for classes, in lower case, in the singular. None that may be grass or not means grass."""

PAINT_ORDER = (Role.VOID, Role.FREE, Role.OBSTACLE, Role.PERSON)
"""Where annotations overlap and the tool gives no order: an obstacle beats grass, a person beats both."""


class Masks(Mapping[str, Mask]):
    """Masks by name; each is read when it is asked for.

    Args:
        label_set: what the ids mean.
        readers: name -> function that reads the mask, (H, W) uint8.
        guessed: classes of the tool whose meaning nobody said, and what they were taken for.
        notes: what else was taken for something, a sentence each.
    """

    def __init__(
        self,
        label_set: LabelSet,
        readers: Mapping[str, Callable[[], Mask]],
        guessed: Mapping[str, str] | None = None,
        notes: Iterable[str] = (),
    ) -> None:
        self.label_set = label_set
        self.guessed, self.notes = dict(guessed or {}), tuple(notes)
        self._readers = dict(readers)

    def __getitem__(self, name: str) -> Mask:
        """The mask of one image, (H, W) uint8 ids of `label_set`."""
        reader = self._readers[name]
        with reading(name, "a mask"):
            return reader()

    def name_of(self, frame: str) -> str | None:
        """Name of a frame's mask: the frame's own, or the only one of that name in any folder; else None."""
        if frame in self._readers:
            return frame
        same = [name for name in self._readers if name.rpartition("/")[2] == frame]
        return same[0] if len(same) == 1 else None

    def __iter__(self) -> Iterator[str]:
        return iter(self._readers)

    def __len__(self) -> int:
        return len(self._readers)


def ids_by_name(
    names: Iterable[str],
    target: LabelSet,
    classes: Mapping[str, str] | None,
    where: str,
    guess: bool = False,
) -> dict[str, int]:
    """Ids in `target` of the names a tool uses.

    Args:
        names: all names of the annotation file.
        target: the set to express masks in.
        classes: name there -> name in `target`, or "void"; `*` stands for all that mean nothing else.
            Without an entry a name stands for itself, and background for void.
        where: the file, for messages.
        guess: take plain words for what they mean (`guessed`); the caller says so to the user.

    Raises:
        InputError: if a name means nothing in `target`: it might be an obstacle.
    """
    wanted = {BACKGROUND: "void", **dict(classes or {})}
    known = {c.name: c.id for c in target.classes} | {"void": VOID_ID}
    for name in wanted.values():
        if name not in known:
            raise InvalidValueError(f"no class '{name}'; known: {', '.join(known)}")
    names = list(names)
    rest = wanted.get("*")
    plain = guessed(names, target, classes) if guess else {}
    meant = {n: wanted.get(n, n if n in known or rest is None else rest) for n in names}
    meant |= plain
    strange = [name for name, meaning in meant.items() if meaning not in known]
    if strange:
        options = " ".join(f"--class '{name}=...'" for name in strange[:12])
        raise InputError(
            f"{where}: nobody says what these classes are: {', '.join(map(repr, strange[:12]))}. "
            f"Say of each which it is, {', '.join(known)}: {options}"
        )
    return {name: known[meaning] for name, meaning in meant.items()}


def guessed(
    names: Iterable[str], target: LabelSet, classes: Mapping[str, str] | None = None
) -> dict[str, str]:
    """What plain words mean in `target`, such as lawn = grass; words with two meanings are not guessed.

    Nor is what `classes` says.

    >>> from swardmap.labels import GRASS_OBSTACLE_PERSON
    >>> guessed(["Lawn", "Trees", "verge", "grass"], GRASS_OBSTACLE_PERSON)
    {'Lawn': 'grass', 'Trees': 'other'}
    """
    own, said = target.names, dict(classes or {})
    if "*" in said:
        return {}
    found = {}
    for name in names:
        word = "".join(c for c in name.lower() if c.isalpha())
        meaning = MEANINGS.get(word) or MEANINGS.get(word.removesuffix("s"))
        told = name in own or name in said or name == "void"
        if meaning in (*own, "void") and meaning is not None and not told:
            found[name] = meaning
    return found


def add_reader(
    readers: dict[str, Callable[[], Mask]], image: str, read: Callable[[], Mask], where: str
) -> None:
    """Enter a mask under the name of its image without the suffix.

    Raises:
        InputError: if the name leads out of a folder, or is there already.
    """
    name = inside(Path(), image.lstrip("/")).with_suffix("").as_posix()
    if name in readers:
        raise InputError(
            f"{where}: expected each image once, got '{name}' twice (an export with augmented copies?)"
        )
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


def fill_polygon(mask: Mask, corners: NDArray[np.float64], value: int, where: str = "") -> None:
    """Set the pixels whose centres (+0.5) lie inside a polygon, by the even-odd rule.

    Args:
        mask: (H, W), changed in place.
        corners: (N, 2) x and y in pixels; 0 is the outer edge of the first pixel.
        value: to set.
        where: file and image, for messages.

    Raises:
        InputError: if it has fewer than three finite corners, or more edges than can be drawn.
    """
    with reading(where, "a polygon"):
        low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
        (left, top), (right, bottom) = np.clip([low, high], 0, mask.shape[::-1]).astype(int)
        part = mask[top:bottom, left:right]
        part[points_inside(np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5, corners)] = value


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
