"""Meshes of simple shapes, with normals and texture coordinates in metres."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.errors import InvalidValueError
from swardmap.synth.model import Float64Array, Material, Mesh, Model


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
    """A box that stands on z = 0, centred on x = y = 0; 24 vertices.

    Texture coordinates are metres: v goes up on the sides, u goes along x where it can.
    """
    corners, normals, uv = [], [], []
    for axis, (across, up, side) in enumerate(((1, 2, 1.0), (0, 2, -1.0), (0, 1, 1.0))):
        for sign in (-1.0, 1.0):
            n, a, b = np.eye(3)[axis] * sign, np.eye(3)[across] * sign * side, np.eye(3)[up]
            for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corners.append((n + a * u + b * v) / 2)
                normals.append(n)
                uv.append((u * size_m[across] / 2, v * size_m[up] / 2))
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


def ellipsoid(
    radii_m: tuple[float, float, float], rings: int = 10, sides: int = 16, material: Material | None = None
) -> Mesh:
    """An ellipsoid that touches z = 0 from above; its vertices lie on the true surface."""
    return moved(sphere(1.0, rings, sides, material), placed(0, 0, scale=radii_m))


def lathe(profile_m: ArrayLike, sides: int = 24, material: Material | None = None) -> Mesh:
    """A surface of revolution about z.

    Args:
        profile_m: k x 2, radius and height, from the bottom up seen from outside; radii of 0 close it.
        sides: segments around.
        material: of all of it.
    """
    profile = np.asarray(profile_m, np.float64)
    step = np.diff(profile, axis=0)
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-9)
    out = np.stack((step[:, 1], -step[:, 0]), axis=1) / length[:, None]  # of each segment, in (r, z)
    normal = np.concatenate([out[:1], (out[:-1] + out[1:]), out[-1:]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    c, s = np.cos(angle), np.sin(angle)
    ones = np.ones_like(c)

    def around(rz: Float64Array) -> Float64Array:
        return np.stack([np.outer(rz[:, 0], c), np.outer(rz[:, 0], s), np.outer(rz[:, 1], ones)], axis=-1)

    along = np.concatenate([[0.0], np.cumsum(length)])
    widest = max(float(profile[:, 0].max()), 1e-6)
    uv = np.stack(np.broadcast_arrays(angle[None] * widest, along[:, None]), axis=-1)
    return mesh_of(around(profile), around(normal), uv, _grid_faces(len(profile), sides + 1), material)


def tube(
    path_m: ArrayLike, radius_m: float | ArrayLike, sides: int = 8, material: Material | None = None
) -> Mesh:
    """A round tube along a line, its ends closed.

    Args:
        path_m: k x 3, its axis.
        radius_m: one, or one for each point of the path.
        sides: segments around.
        material: of all of it.
    """
    path = np.asarray(path_m, np.float64)
    if path.ndim != 2 or path.shape[1] != 3 or len(path) < 2:
        raise InvalidValueError(f"tube: expected a path of at least 2 x 3, got {path.shape}")
    radius = np.broadcast_to(np.asarray(radius_m, np.float64), len(path))
    a, b, tangent = _frames_along(path)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    spokes = a[:, None] * np.cos(angle)[None, :, None] + b[:, None] * np.sin(angle)[None, :, None]
    rings = path[:, None] + spokes * radius[:, None, None]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(angle[None] * radius[:, None], along[:, None]), axis=-1)
    n = sides + 1
    faces = _grid_faces(len(path), n)
    parts = [mesh_of(rings, spokes, uv, faces, material)]
    k = np.arange(sides)
    for end, sign in ((0, -1.0), (-1, 1.0)):
        order = (k + 1, k + 2) if sign > 0 else (k + 2, k + 1)
        fan = np.stack((np.zeros(sides, np.intp), *order), axis=1)
        xyz = np.concatenate([path[end][None], rings[end]])
        normals = np.tile(tangent[end] * sign, (n + 1, 1))
        parts.append(mesh_of(xyz, normals, np.zeros((n + 1, 2)), fan, material))
    return joined(parts)


def beam(
    start_m: ArrayLike, end_m: ArrayLike, size_m: tuple[float, float], material: Material | None = None
) -> Mesh:
    """A bar of rectangular section between two points; the first size lies level, the second stands."""
    start, end = np.asarray(start_m, np.float64), np.asarray(end_m, np.float64)
    axis = end - start
    length = float(np.linalg.norm(axis))
    if length <= 0:
        raise InvalidValueError("beam: expected two points that differ, got the same twice")
    x = axis / length
    side = np.cross([0.0, 0.0, 1.0], x)
    y = side / np.linalg.norm(side) if np.linalg.norm(side) > 1e-6 else np.array([0.0, 1.0, 0.0])
    T = np.eye(4)
    T[:3, :3] = np.stack((x, y, np.cross(x, y)), axis=1)
    T[:3, 3] = (start + end) / 2
    centred = moved(box((length, *size_m), material), placed(0, 0, -size_m[1] / 2))
    return moved(centred, T)


def cards(
    centres_m: ArrayLike, normals: ArrayLike, size_m: ArrayLike, turn_rad: ArrayLike,
    shading: ArrayLike | None = None, material: Material | None = None,
) -> Mesh:  # fmt: skip
    """Square pictures in space, such as leaves; each shows the whole texture.

    Args:
        centres_m: n x 3.
        normals: n x 3, of length 1: where the cards face.
        size_m: edge, one or n.
        turn_rad: of each card about its normal, one or n.
        shading: n x 3, the normals for the light; None = where the cards face.
        material: of all of it; usually a cut-out.
    """
    centre, n = np.asarray(centres_m, np.float64), np.asarray(normals, np.float64)
    helper = np.where(np.abs(n[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    a = np.cross(helper, n)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(n, a)
    turn = np.broadcast_to(np.asarray(turn_rad, np.float64), len(n))[:, None]
    a, b = a * np.cos(turn) + b * np.sin(turn), b * np.cos(turn) - a * np.sin(turn)
    half = np.broadcast_to(np.asarray(size_m, np.float64), len(n))[:, None] / 2
    corners = [centre + half * (u * a + v * b) for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    quads = np.arange(4 * len(n)).reshape(-1, 4)
    light = np.asarray(n if shading is None else shading, np.float64)
    return mesh_of(
        np.stack(corners, axis=1), np.repeat(light, 4, axis=0),
        np.tile([[0, 0], [1, 0], [1, 1], [0, 1]], (len(n), 1)),
        np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), material,
    )  # fmt: skip


def model_of(name: str, meshes: list[Mesh]) -> Model:
    """A model with one mesh for each material, however many parts came in."""
    by_material: dict[int, list[Mesh]] = {}
    for mesh in meshes:
        by_material.setdefault(id(mesh.material), []).append(mesh)
    return Model(name, tuple(joined(parts) for parts in by_material.values()))


def _frames_along(path: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Two normals and the tangent at each point, carried along without twist where the path bends."""
    step = np.diff(path, axis=0)
    step /= np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
    tangent = np.concatenate([step[:1], step[:-1] + step[1:], step[-1:]])
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    a = np.zeros_like(path)
    start = np.eye(3)[int(np.argmin(np.abs(tangent[0])))]
    for i, t in enumerate(tangent):
        before = start if i == 0 else a[i - 1]
        a[i] = before - t * (before @ t)
        a[i] /= max(float(np.linalg.norm(a[i])), 1e-12)
    return a, np.cross(tangent, a), tangent
