"""Classes of an image and of a map, and the tables between them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError

VOID_ID = 255


class Role(StrEnum):
    """What a class means for a robot: may be driven on, must be avoided, or says nothing."""

    FREE = "free"
    OBSTACLE = "obstacle"
    PERSON = "person"  # an obstacle with its own margin and its own rule for clearing
    VOID = "void"


class MapClass(IntEnum):
    """State of a map cell (Sec. 4.3); numbers are those of the class arrays, not of nav_msgs."""

    UNKNOWN = 0
    GRASS = 1
    OBSTACLE = 2
    PERSON = 3


MAP_CLASS_OF_ROLE: Mapping[Role, MapClass] = {
    Role.FREE: MapClass.GRASS,
    Role.OBSTACLE: MapClass.OBSTACLE,
    Role.PERSON: MapClass.PERSON,
    Role.VOID: MapClass.UNKNOWN,
}


@dataclass(frozen=True, slots=True)
class LabelClass:
    """One class of an image: id in the mask, name, role and display colour (RGB)."""

    id: int
    name: str
    role: Role
    color: tuple[int, int, int]

    def __post_init__(self) -> None:
        if not 0 <= self.id <= VOID_ID:
            raise InvalidValueError(f"class '{self.name}': expected an id in 0..255, got {self.id}")
        if len(self.color) != 3 or not all(0 <= c <= 255 for c in self.color):
            raise InvalidValueError(
                f"class '{self.name}': expected a colour of three numbers in 0..255, got {self.color}"
            )
        object.__setattr__(self, "role", Role(self.role))


@dataclass(frozen=True)
class LabelSet:
    """The classes a mask may hold. An id that is not declared counts as void, never as free.

    Attributes:
        classes: one LabelClass for each id; ids and names are unique.
    """

    classes: tuple[LabelClass, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "classes", tuple(self.classes))
        for what, values in (
            ("id", [str(c.id) for c in self.classes]),
            ("name", [c.name for c in self.classes]),
        ):
            twice = {v for v in values if values.count(v) > 1}
            if twice:
                raise InvalidValueError(
                    f"label set: expected each {what} once, got twice: {', '.join(sorted(twice))}"
                )

    def __getitem__(self, name: str) -> LabelClass:
        for label in self.classes:
            if label.name == name:
                return label
        names = ", ".join(c.name for c in self.classes)
        raise InvalidValueError(f"no class '{name}' in the label set; it has: {names}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names in the order of declaration."""
        return tuple(c.name for c in self.classes)

    @cached_property
    def map_class_table(self) -> NDArray[np.uint8]:
        """(256,) uint8: mask id -> MapClass; ids that are not declared become UNKNOWN."""
        table = np.full(256, MapClass.UNKNOWN, np.uint8)
        for label in self.classes:
            table[label.id] = MAP_CLASS_OF_ROLE[label.role]
        return _frozen(table)

    @cached_property
    def color_table(self) -> NDArray[np.uint8]:
        """(256, 3) uint8: mask id -> RGB; ids that are not declared are black."""
        table = np.zeros((256, 3), np.uint8)
        for label in self.classes:
            table[label.id] = label.color
        return _frozen(table)

    def remap_table(self, target: "LabelSet", names: Mapping[str, str] | None = None) -> NDArray[np.uint8]:
        """Table from ids of this set to ids of `target`, void where nothing fits.

        Args:
            target: the set to express masks in.
            names: name here -> name there. Without an entry a class keeps its name; a name that
                `target` lacks becomes the first class of `target` with the same role.

        Returns:
            (256,) uint8; apply it as `table[mask]`.
        """
        wanted = dict(names or {})
        for name in wanted:
            _ = self[name]
        table = np.full(256, VOID_ID, np.uint8)
        for label in self.classes:
            name = wanted.get(label.name, label.name)
            if name in target.names:
                table[label.id] = target[name].id
            elif label.name in wanted:
                table[label.id] = target[name].id  # raises: the user named a class that is not there
            else:
                table[label.id] = _first_id_of_role(target.classes, label.role)
        return _frozen(table)


def _first_id_of_role(classes: Iterable[LabelClass], role: Role) -> int:
    same = [c.id for c in classes if c.role is role]
    if not same and role is Role.PERSON:  # a person is an obstacle where there is no better word
        same = [c.id for c in classes if c.role is Role.OBSTACLE]
    return same[0] if same else VOID_ID


def _frozen(array: NDArray[np.uint8]) -> NDArray[np.uint8]:
    array.flags.writeable = False
    return array


OTHER = LabelClass(0, "other", Role.OBSTACLE, (66, 103, 178))
GRASS = LabelClass(1, "grass", Role.FREE, (104, 180, 84))
PERSON = LabelClass(2, "person", Role.PERSON, (240, 180, 40))
VOID = LabelClass(VOID_ID, "void", Role.VOID, (60, 60, 60))

GRASS_OBSTACLE = LabelSet((OTHER, GRASS, VOID))
"""The paper's first model: other, grass (Sec. 3.3)."""

GRASS_OBSTACLE_PERSON = LabelSet((OTHER, GRASS, PERSON, VOID))
"""The paper's second model: other, grass, person (Sec. 3.3)."""
