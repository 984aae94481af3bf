"""Meshes of simple shapes, with normals and texture coordinates in metres."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.errors import InvalidValueError
from swardmap.synth.model import Float64Array, Material, Mesh


def mesh_of(
    xyz: ArrayLike, normals: ArrayLike, uv: ArrayLike, faces: ArrayLike, material: Material | None = None
) -> Mesh:
    """A mesh from anything array-like, in the types that a mesh has."""
    return Mesh(
        np.ascontiguousarray(xyz, np.float32).reshape(-1, 3),
        np.ascontiguousarray(normals, np.float32).reshape(-1, 3),
        np.ascontiguousarray(uv, np.float32).reshape(-1, 2),
        np.ascontiguousarray(faces, np.uint32).reshape(-1, 3),
        material or Material(),
    )


def joined(meshes: list[Mesh]) -> Mesh:
    """Many meshes as one, with the material of the first."""
    if not meshes:
        raise InvalidValueError("joined: expected at least one mesh, got none")
    first = np.cumsum([0, *(len(mesh.xyz) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.xyz for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.uv for mesh in meshes]),
        np.concatenate([mesh.faces + np.uint32(k) for mesh, k in zip(meshes, first, strict=False)]),
        meshes[0].material,
    )


def moved(mesh: Mesh, T: Float64Array) -> Mesh:
    """The same mesh under a 4 x 4 transform; normals stay right under scales that differ by axis."""
    linear = T[:3, :3]
    normals = mesh.normals @ np.linalg.inv(linear)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return mesh_of(mesh.xyz @ linear.T + T[:3, 3], normals, mesh.uv, mesh.faces, mesh.material)


def placed(
    x_m: float, y_m: float, z_m: float = 0.0, yaw_rad: float = 0.0, scale: ArrayLike = 1.0
) -> Float64Array:
    """A 4 x 4 transform: scale, then turn about z, then move."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    T = np.eye(4)
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag(np.broadcast_to(scale, 3))
    T[:3, 3] = x_m, y_m, z_m
    return T


def box(size_m: tuple[float, float, float], material: Material | None = None) -> Mesh:
    """A box that stands on z = 0, centred on x = y = 0; 24 vertices, uv in metres along each side."""
    corners, normals, uv = [], [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            a, b = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3] * sign
            n = np.eye(3)[axis] * sign
            for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corners.append((n + a * u + b * v) / 2)
                normals.append(n)
                uv.append((u * size_m[(axis + 1) % 3] / 2, v * size_m[(axis + 2) % 3] / 2))
    xyz = np.array(corners) * size_m + [0, 0, size_m[2] / 2]
    quads = np.arange(24).reshape(6, 4)
    return mesh_of(xyz, normals, uv, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), material)


def cylinder(
    radius_m: float, height_m: float, sides: int = 24, top_radius_m: float | None = None,
    material: Material | None = None,
) -> Mesh:  # fmt: skip
    """A cylinder or cone that stands on z = 0, with flat caps; its vertices lie on the true circle."""
    r1 = radius_m if top_radius_m is None else top_radius_m
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    c, s = np.cos(angle), np.sin(angle)
    slope = (radius_m - r1) / height_m
    around = np.stack((c, s, np.full_like(c, slope)), axis=1) / np.hypot(1, slope)
    rings = [
        np.stack((c * r, s * r, np.full_like(c, z)), axis=1) for r, z in ((radius_m, 0.0), (r1, height_m))
    ]
    n = sides + 1
    k = np.arange(sides)
    side_faces = np.concatenate([np.stack((k, k + 1, k + n + 1), 1), np.stack((k, k + n + 1, k + n), 1)])
    side_uv = [np.stack((angle * radius_m, np.full_like(c, z)), axis=1) for z in (0.0, height_m)]
    xyz, normals, uv = np.concatenate(rings), np.tile(around, (2, 1)), np.concatenate(side_uv)
    parts = [mesh_of(xyz, normals, uv, side_faces, material)]
    for ring, up in zip(rings, (-1.0, 1.0), strict=True):
        fan = np.stack((np.zeros(sides), k + 1, k + 2) if up > 0 else (np.zeros(sides), k + 2, k + 1), 1)
        xyz = np.concatenate([[[0, 0, ring[0, 2]]], ring])
        parts.append(mesh_of(xyz, np.tile([0, 0, up], (n + 1, 1)), xyz[:, :2], fan, material))
    return joined(parts)


def sphere(radius_m: float, rings: int = 16, sides: int = 24, material: Material | None = None) -> Mesh:
    """A sphere that touches z = 0 from above; its vertices lie on the true sphere."""
    lat, lon = np.meshgrid(
        np.linspace(-np.pi / 2, np.pi / 2, rings + 1), np.linspace(0, 2 * np.pi, sides + 1), indexing="ij"
    )
    normals = np.stack((np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)), axis=-1).reshape(
        -1, 3
    )
    uv = np.stack((lon / (2 * np.pi), lat / np.pi + 0.5), axis=-1)
    return mesh_of(
        normals * radius_m + [0, 0, radius_m], normals, uv, _grid_faces(rings + 1, sides + 1), material
    )


def _grid_faces(rows: int, columns: int) -> NDArray[np.intp]:
    """Two triangles for each square of a grid of vertices, row by row."""
    at = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = at[:-1, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, 1:].ravel(), at[1:, :-1].ravel()
    return np.concatenate([np.stack((a, b, c), 1), np.stack((a, c, d), 1)])
