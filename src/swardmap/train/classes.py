"""The classes that a network is taught: one of the paper's two sets, or the user's own."""

import re
from collections.abc import Mapping

from swardmap.errors import ConfigError
from swardmap.labels import (
    GRASS,
    GRASS_OBSTACLE,
    GRASS_OBSTACLE_PERSON,
    OTHER,
    PERSON,
    VOID,
    LabelClass,
    LabelSet,
    Role,
)

PAPER_SETS: Mapping[str, LabelSet] = {
    "grass-obstacle": GRASS_OBSTACLE,
    "grass-obstacle-person": GRASS_OBSTACLE_PERSON,
}
MOST_CLASSES = 50
NAME = re.compile(r"[a-z][a-z0-9_]*")
COLORS = {Role.OBSTACLE: OTHER.color, Role.FREE: GRASS.color, Role.PERSON: PERSON.color}


def read_classes(text: str) -> LabelSet:
    """The label set that a recipe's `classes` names or spells out.

    Args:
        text: `grass-obstacle`, `grass-obstacle-person`, or `name=role` with commas between, such as
            `other=obstacle,grass=free,person=person,flowers=obstacle`; ids count from 0.

    Raises:
        ConfigError: for text that is neither, a name given twice, or classes of which none is free to drive
            on or none is an obstacle.
    """
    if text in PAPER_SETS:
        return PAPER_SETS[text]
    example = f"expected {', '.join(PAPER_SETS)}, or classes as other=obstacle,grass=free,person=person"
    pairs = [tuple(part.strip() for part in entry.partition("=")) for entry in text.split(",")]
    for name, sign, role in pairs:
        if not (sign and NAME.fullmatch(name) and role in COLORS):
            raise ConfigError(f"{example} (roles: {', '.join(COLORS)}), got '{text}'")
    roles = [Role(role) for _, _, role in pairs]
    if len({name for name, _, _ in pairs} | {VOID.name}) <= len(pairs) or len(pairs) > MOST_CLASSES:
        raise ConfigError(f"{example}; at most {MOST_CLASSES}, each name once and none 'void', got '{text}'")
    if Role.FREE not in roles or Role.OBSTACLE not in roles:
        raise ConfigError(f"{example}; at least one free and one obstacle, got '{text}'")
    classes = (
        LabelClass(i, name, role, _color(role, roles[:i].count(role)))
        for i, ((name, _, _), role) in enumerate(zip(pairs, roles, strict=True))
    )
    return LabelSet((*classes, VOID))


def classes_text(label_set: LabelSet) -> str:
    """The text for which `read_classes` gives these classes."""
    for name, known in PAPER_SETS.items():
        if known == label_set:
            return name
    return ",".join(f"{c.name}={c.role}" for c in label_set.classes if c.role is not Role.VOID)


def _color(role: Role, before: int) -> tuple[int, int, int]:
    """That of the role, paler for each class before it that has the same."""
    white = before / (before + 2)
    red, green, blue = (round(c + (255 - c) * white) for c in COLORS[role])
    return red, green, blue
