"""What a body wears or is: shells with a material, ready to follow the skeleton."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.synth.model import Float32Array, Float64Array, Material, Mesh
from swardmap.synth.people.body import ARM, LEG, Body, Shell
from swardmap.synth.people.shell import normals_of, unique_rows, welded
from swardmap.synth.people.skeleton import Bones, skinned


@dataclass(frozen=True, slots=True, eq=False)
class Worn:
    """A shell with its texture coordinates and material.

    Attributes:
        shell: at rest.
        uv: n x 2.
        place: n: vertices of one place share a normal.
        faces: m x 3, those of the shell: all models of a figure share them.
        material: of all faces.
        what: skin, hair, shoes, hat, or the name of a garment.
    """

    shell: Shell
    uv: Float32Array
    place: NDArray[np.int64]
    faces: NDArray[np.uint32]
    material: Material
    what: str


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """A body with all that it wears, at rest."""

    body: Body
    worn: tuple[Worn, ...]


def meshes_of(figure: Figure, bones: Bones) -> tuple[list[Mesh], Float64Array]:
    """The figure's meshes with its pelvis' joint at the origin, and all their points."""
    meshes, points = [], []
    for worn in figure.worn:
        xyz = skinned(worn.shell.xyz, worn.shell.weights, figure.body, bones)
        normals = normals_of(xyz, worn.shell.faces, worn.place)
        meshes.append(
            Mesh(
                xyz.astype(np.float32), normals.astype(np.float32), worn.uv,
                worn.faces, worn.material,
            )
        )  # fmt: skip
        points.append(xyz)
    return meshes, np.concatenate(points)


def worn_cloth(shell: Shell, material: Material, what: str) -> Worn:
    """Cloth with texture coordinates around the trunk and each limb: metres of cloth, 0.25 m to a tile."""
    centre = shell.mean[shell.faces].mean(1)
    along = shell.along[shell.faces].mean(1)
    left = centre[:, 1] > 0
    kind = np.where(along[:, ARM] > 0.02, 1 + left, np.where(along[:, LEG] > 0.12, 3 + left, 0))
    corner = shell.mean[shell.faces]
    uv = np.zeros((*shell.faces.shape, 2))
    for k in range(5):
        these = kind == k
        if these.any():
            uv[these] = _around(corner[these], k)
    return split_worn(shell, uv, material, what)


def _around(corner: Float64Array, kind: int) -> Float64Array:
    """M x 3 corners x 2: angle about an upright or a sloping axis, and the height along it."""
    points = corner.reshape(-1, 3)
    middle = (points.min(0) + points.max(0)) / 2
    axis = np.array([0.0, 0, 1])
    if kind in (1, 2):
        axis = np.array([0.0, -0.7 if kind == 2 else 0.7, 0.714])
    ahead = np.array([1.0, 0, 0])
    side = np.cross(axis, ahead)
    centred = corner - middle
    angle = np.arctan2(centred @ side, -(centred @ ahead)) / (
        2 * np.pi
    )  # the seam is in front of nothing: behind
    angle = np.where(np.ptp(angle, axis=1)[:, None] > 0.5, angle % 1, angle)
    tiles = 4.0 if kind == 0 else 2.0
    return np.stack((angle * tiles, centred @ axis / 0.25), axis=-1)


def split_worn(shell: Shell, uv: Float64Array, material: Material, what: str) -> Worn:
    """Vertices told apart where faces disagree about texture coordinates (m x 3 x 2)."""
    key = np.concatenate([shell.faces.reshape(-1, 1), np.round(uv.reshape(-1, 2) * 4096).astype(np.int64)], 1)
    first, faces, _ = unique_rows(key)
    unique = key[first]
    old = unique[:, 0]
    split = Shell(
        shell.xyz[old], shell.weights[old], shell.along[old], shell.mean[old],
        faces.reshape(-1, 3).astype(np.int64),
    )  # fmt: skip
    return Worn(
        split,
        (unique[:, 1:] / 4096).astype(np.float32),
        welded(shell)[old],
        split.faces.astype(np.uint32),
        material,
        what,
    )


def plain_worn(shell: Shell, material: Material, what: str, uv: Float64Array | None = None) -> Worn:
    """A shell whose texture coordinates are given per vertex, or not needed."""
    given = np.zeros((len(shell.xyz), 2)) if uv is None else uv
    return Worn(shell, given.astype(np.float32), welded(shell), shell.faces.astype(np.uint32), material, what)


def rigid(body: Body, bone: str, mesh: Mesh, at: Float64Array) -> Worn:
    """A mesh fixed to one bone; `at` is where its origin lies on the body at rest."""
    xyz = mesh.xyz.astype(np.float64) + at
    weights = np.zeros((len(xyz), len(body.bones)))
    weights[:, body.bones.index(bone)] = 1
    shell = Shell(xyz, weights, np.full((len(xyz), 4), -1.0), xyz, mesh.faces.astype(np.int64))
    key = np.round(np.hstack([mesh.xyz, mesh.normals]) * 1e3).astype(np.int64)
    return Worn(shell, mesh.uv, unique_rows(key)[1], mesh.faces, mesh.material, bone)


def put_down(
    meshes: Sequence[Mesh],
    points: Float64Array,
    centre: tuple[float, float] | None = None,
    z_m: float | None = None,
) -> tuple[Mesh, ...]:
    """The meshes moved: the lowest point to z = 0, `centre` (default: of the box) above the origin."""
    low, high = points.min(0), points.max(0)
    middle = centre if centre is not None else (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2)
    shift = np.array([-middle[0], -middle[1], -low[2] if z_m is None else z_m], np.float32)
    return tuple(Mesh(m.xyz + shift, m.normals, m.uv, m.faces, m.material) for m in meshes)
