"""Shared by the tests of people: the shipped assets, figures that are dressed once, distances on meshes."""

from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np

from swardmap.synth.assets import Assets, open_assets
from swardmap.synth.model import Float64Array, Mesh
from swardmap.synth.people.figure import figure_of
from swardmap.synth.people.worn import Figure

FOLDER = Path(__file__).parents[3] / "garden_assets" / "swardmap_garden_assets"


@cache
def assets() -> Assets:
    return open_assets(FOLDER)


@cache
def figure(group: str, seed: int = 0) -> Figure:
    return figure_of(np.random.default_rng([seed, 7]), assets(), group, hatted="")


def points_of(meshes: Iterable[Mesh]) -> Float64Array:
    return np.concatenate([mesh.xyz for mesh in meshes]).astype(np.float64)


def volume_m3(xyz: Float64Array, faces: np.ndarray) -> float:
    """Enclosed by faces that run counter-clockwise seen from outside (divergence theorem)."""
    return float(np.linalg.det(xyz[faces] - xyz.mean(axis=0)).sum() / 6)
