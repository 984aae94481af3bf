"""Bodies: rest shapes on one set of faces and one skeleton, made by `tools/bake_people`."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.synth.model import Float64Array

UNIT_M = 2.0**-14
PARTS = ("body", "tights", "skirt")
ARM, LEG, TRUNK, NECK = range(4)  # columns of Shell.along


@dataclass(frozen=True, slots=True, eq=False)
class Shell:
    """A surface that follows the skeleton: skin or cloth, at rest.

    Attributes:
        xyz: n x 3, metres, x front, y left, z up.
        weights: n x bones, each row sums to 1.
        along: n x 4: where it lies along the arm (0 shoulder, 1 elbow, 2 wrist), along the leg (0 hip,
            1 knee, 2 ankle), up the trunk (0 hip, 1 neck) and up the neck (0 its root, 1 the head);
            -1 on the arm column means no arm, the same on the leg.
        mean: n x 3: its place on the mean adult, the same for all bodies: textures and hair go by it.
        faces: m x 3.
    """

    xyz: Float64Array
    weights: Float64Array
    along: Float64Array
    mean: Float64Array
    faces: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One person undressed and at rest.

    Attributes:
        group: boy, girl, man, woman, old man or old woman.
        bones: their names; `parents` has the index of each one's parent, -1 for the first.
        joints: bones x 3, metres.
        skin, tights, skirt: the surface, and the two that clothes are cut from.
        head_mean, mouth_mean, eyes_mean: landmarks in the coordinates of `Shell.mean`.
    """

    group: str
    bones: tuple[str, ...]
    parents: tuple[int, ...]
    joints: Float64Array
    skin: Shell
    tights: Shell
    skirt: Shell
    head_mean: Float64Array
    mouth_mean: Float64Array
    eyes_mean: Float64Array

    @property
    def height_m(self) -> float:
        """From sole to crown, at rest."""
        return float(np.ptp(self.skin.xyz[:, 2]))

    @property
    def is_child(self) -> bool:
        """Whether it is one of the children."""
        return self.group in ("boy", "girl")

    @property
    def is_female(self) -> bool:
        """Whether it is a girl or woman."""
        return self.group in ("girl", "woman", "old woman")


class Assets(Protocol):
    """What people are made from: `swardmap.synth.assets.Assets`, or anything with the same method."""

    def arrays(self, name: str) -> Mapping[str, NDArray[Any]]:
        """The set of arrays of a name; people need `people`."""


def body_of(assets: Assets, group: str, rng: np.random.Generator) -> Body:
    """A body between two neighbours of a group, in age (children) or build (adults), by chance."""
    arrays = assets.arrays("people")
    groups = [str(name) for name in arrays["groups"]]
    mine = np.array([k for k, name in enumerate(groups) if name == group])
    if len(mine) < 2:
        raise InvalidValueError(f"expected a group of people in {sorted(set(groups))}, got '{group}'")
    first = int(rng.integers(len(mine) - 1))
    share = float(rng.uniform(0, 1))
    mix = np.zeros(len(groups))
    mix[mine[first]], mix[mine[first + 1]] = 1 - share, share
    bones = tuple(str(name) for name in arrays["bones"])
    skin, tights, skirt = (_shell(arrays, part, mix, len(bones)) for part in PARTS)
    return Body(
        group, bones, tuple(int(k) for k in arrays["parents"]),
        np.tensordot(mix, arrays["joints"].astype(np.float64) * UNIT_M, 1), skin, tights, skirt,
        arrays["head_mean"].astype(np.float64), arrays["mouth"].astype(np.float64),
        arrays["eyes"].astype(np.float64),
    )  # fmt: skip


def _shell(arrays: Mapping[str, NDArray[Any]], part: str, mix: Float64Array, bones: int) -> Shell:
    used = np.flatnonzero(mix)
    xyz = np.tensordot(mix[used], arrays[f"{part}_xyz"][used].astype(np.float64) * UNIT_M, 1)
    weights = np.zeros((len(xyz), bones))
    np.put_along_axis(
        weights, arrays[f"{part}_bone"].astype(np.int64), arrays[f"{part}_weight"].astype(np.float64) / 255, 1
    )
    return Shell(
        xyz, weights, arrays[f"{part}_along"].astype(np.float64), arrays[f"{part}_mean"].astype(np.float64),
        arrays[f"{part}_faces"].astype(np.int64),
    )  # fmt: skip
