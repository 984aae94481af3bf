"""What a polygon of a work area is for, from the words that tools and people put beside it."""

from collections.abc import Mapping
from typing import Any

from swardmap.mapping.work_area import AreaRole, Ring

Found = tuple[AreaRole | None, str, tuple[Ring, ...]]
"""AreaRole or None, name, rings of (longitude, latitude)."""

ROLE_KEYS = ("role", "type", "kind")
"""Properties that say what a polygon is for, in any case."""

BOUNDARY_WORDS = (
    "boundary inclusion inclusive include included perimeter keepin workarea workingarea operation "
    "navigation mow mowing mowingarea"
)
EXCLUSION_WORDS = (
    "exclusion exclusive exclude excluded exclusionzone keepout nogo nogozone forbidden restricted avoid "
    "obstacle hole"
)
ROLE_OF_WORD: Mapping[str, AreaRole] = {
    **dict.fromkeys(BOUNDARY_WORDS.split(), AreaRole.BOUNDARY),
    **dict.fromkeys(EXCLUSION_WORDS.split(), AreaRole.EXCLUSION),
}
"""Words that mean a role, without blanks and strokes: ours, and those of mowers and flight planners."""

SAYS_NOTHING = frozenset({"polygon", "multipolygon", "feature", "way", "relation", "area", "none"})
"""Words under `type` that say what the thing is drawn as."""


def role_of(properties: Mapping[str, Any], name: str) -> AreaRole | None:
    """The role that the words of a feature give it; None if there is none."""
    words = {str(key).lower(): value for key, value in properties.items()}
    roles: dict[str, AreaRole] = {}
    for key in ROLE_KEYS:
        word = words.get(key)
        if word is None or (isinstance(word, str) and (not word.strip() or _plain(word) in SAYS_NOTHING)):
            continue
        if not isinstance(word, str):
            raise ValueError(f"{name}: expected the {key} to be a word, got {word!r}")
        role = ROLE_OF_WORD.get(_plain(word))
        if role is None:
            raise ValueError(
                f"polygon '{name}': is '{word}' a boundary or an exclusion? Expected the role boundary or "
                f"exclusion, got '{word}' ({key}): give it the property role"
            )
        roles[key] = role
    if len(set(roles.values())) > 1:
        told = ", ".join(f"{key} says {role}" for key, role in roles.items())
        raise ValueError(f"polygon '{name}': {told}; expected one of them")
    return next(iter(roles.values()), None) or _role_in_name(name)


def _role_in_name(name: str) -> AreaRole | None:
    """`Exclusion pond`, `boundary: front`, `No-go_bed`: the first word, or the first two."""
    words = name.lower().replace("_", " ").replace(":", " ").replace("-", " ").split()
    for count in (2, 1):
        if len(words) >= count and (role := ROLE_OF_WORD.get("".join(words[:count]))):
            return role
    return None


def _plain(word: str) -> str:
    return "".join(c for c in word.lower() if c.isalnum())
