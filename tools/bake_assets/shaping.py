"""Make clean meshes of triangle soups: hidden parts off, lighter, turned outward, with normals, indexed."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from swardmap.synth.model import Material, Mesh
from tools.bake_assets.visibility import seen_pixels

SHEET_SHARE = 0.005
"""A part of which more than this is seen from behind is a sheet, with two sides."""
FOLIAGE_PIECES, FOLIAGE_TRIANGLES = 150, 60
"""A part of at least so many pieces with fewer triangles each is foliage."""
CREASE_RAD = np.deg2rad(50)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Triangles of one material, corner by corner: m x 3 x 3, m x 3 x 3 (0 = unknown), m x 3 x 2."""

    xyz: NDArray[np.float64]
    normals: NDArray[np.float64]
    uv: NDArray[np.float64]
    material: Material

    def only(self, chosen: NDArray[np.bool_]) -> "Part":
        """The chosen triangles."""
        return replace(self, xyz=self.xyz[chosen], normals=self.normals[chosen], uv=self.uv[chosen])


def cleaned(parts: list[Part], max_triangles: int) -> list[Mesh]:
    """Parts of one model as meshes: nothing hidden, at most about so many triangles, turned outward."""
    parts = _without_hidden([_without_slivers(part) for part in parts])
    total = sum(len(part.xyz) for part in parts)
    if total > max_triangles:
        parts = _without_slivers_all([lightened(part, max_triangles / total) for part in parts])
    return [indexed(part) for part in merged(outward(parts))]


def merged(parts: list[Part]) -> list[Part]:
    """Parts of equal materials as one."""
    groups: dict[object, list[Part]] = {}
    for part in parts:
        m = part.material
        key = (m.texture.name if m.texture else np.round(m.color, 2).tobytes(), m.cutout, m.specular > 0.3)
        groups.setdefault(key, []).append(part)
    return [
        Part(
            np.concatenate([p.xyz for p in group]), np.concatenate([p.normals for p in group]),
            np.concatenate([p.uv for p in group]), group[0].material,
        )
        for group in groups.values()
    ]  # fmt: skip


def lightened(part: Part, share: float) -> Part:
    """Fewer triangles: of foliage fewer and larger leaves, of the rest fewer and larger triangles."""
    piece = components(part.xyz)
    if piece.max() + 1 >= FOLIAGE_PIECES and len(part.xyz) / (piece.max() + 1) < FOLIAGE_TRIANGLES:
        return thinned(part, piece, share)
    lighter = simplified(part, share)
    too_many = len(lighter.xyz) / max(len(part.xyz) * share, 1)
    if too_many > 1.3 and piece.max() + 1 >= FOLIAGE_PIECES:
        return thinned(lighter, components(lighter.xyz), 1 / too_many)
    return lighter


def thinned(part: Part, piece: NDArray[np.int64], share: float) -> Part:
    """Some of the connected pieces, chosen by chance, enlarged so that they cover the same area."""
    count = int(piece.max()) + 1
    kept = np.random.default_rng(0).permutation(count) < max(count * share, 1)
    size = np.bincount(piece)
    middle = np.stack(
        [np.bincount(piece, weights=part.xyz[..., axis].mean(axis=1)) / size for axis in range(3)], axis=1
    )
    grown = middle[piece][:, None] + (part.xyz - middle[piece][:, None]) * min(share**-0.5, 1.8)
    return replace(part, xyz=grown).only(kept[piece])


def simplified(part: Part, share: float) -> Part:
    """Fewer triangles by quadric edge collapse that keeps texture coordinates (pymeshlab)."""
    import pymeshlab  # type: ignore[import-not-found]  # of the bake alone

    target = max(int(len(part.xyz) * share), 12)
    if len(part.xyz) <= max(target, 60):
        return part
    vertices, inverse = np.unique(np.round(part.xyz.reshape(-1, 3), 5), axis=0, return_inverse=True)
    faces = inverse.reshape(-1, 3)
    meshes = pymeshlab.MeshSet()
    if part.material.texture is None:
        meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
        meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=target, preservenormal=True)
        mesh = meshes.current_mesh()
        uv = np.zeros((mesh.face_number(), 3, 2))
    else:
        with tempfile.TemporaryDirectory() as folder:
            meshes.load_new_mesh(str(_obj_file(Path(folder), vertices, faces, part.uv)))
        meshes.meshing_decimation_quadric_edge_collapse_with_texture(
            targetfacenum=target, preservenormal=True
        )
        mesh = meshes.current_mesh()
        uv = mesh.wedge_tex_coord_matrix().reshape(-1, 3, 2)
    xyz = mesh.vertex_matrix()[mesh.face_matrix()]
    return Part(xyz, np.zeros_like(xyz), uv, part.material)


def _obj_file(
    folder: Path, vertices: NDArray[np.float64], faces: NDArray[np.int64], uv: NDArray[np.float64]
) -> Path:
    """An OBJ file with a texture, the only way in which pymeshlab takes texture coordinates of corners."""
    (folder / "dummy.ppm").write_bytes(b"P6 1 1 255\n" + bytes(3))
    (folder / "mesh.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd dummy.ppm\n")
    corners = np.arange(1, faces.size + 1).reshape(-1, 3)
    lines = ["mtllib mesh.mtl", *(f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist())]
    lines += [f"vt {u:.7g} {v:.7g}" for u, v in uv.reshape(-1, 2).tolist()] + ["usemtl m"]
    for (a, b, c), (i, j, k) in zip((faces + 1).tolist(), corners.tolist(), strict=True):
        lines.append(f"f {a}/{i} {b}/{j} {c}/{k}")
    (folder / "mesh.obj").write_text("\n".join(lines) + "\n")
    return folder / "mesh.obj"


def outward(parts: list[Part]) -> list[Part]:
    """The same parts with every triangle's front outside; sheets become parts with two sides (cutout)."""
    xyz = np.concatenate([part.xyz for part in parts])
    front, back = seen_pixels(xyz)
    component = components(xyz)
    f, b = (np.bincount(component, weights=side) for side in (front, back))
    hidden_side = np.bincount(component, weights=np.minimum(front, back))
    sheet = (hidden_side > SHEET_SHARE * (f + b))[component]
    flip = np.where(front + back > 0, back > front, (b > f)[component])
    flip = np.where(sheet, (b > f)[component], flip)
    done, at = [], 0
    for part in parts:
        chosen = slice(at, at + len(part.xyz))
        at += len(part.xyz)
        turned = _flipped(part, flip[chosen])
        two_sided = replace(part.material, cutout=True)
        done.append(turned.only(~sheet[chosen]))
        done.append(replace(turned.only(sheet[chosen]), material=two_sided))
    return [part for part in done if len(part.xyz)]


def components(xyz: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number of the connected piece of each triangle; corners at the same place connect."""
    _, inverse = np.unique(np.round(xyz.reshape(-1, 3), 5), axis=0, return_inverse=True)
    faces = inverse.reshape(-1, 3)
    n = int(faces.max()) + 1
    i, j = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    _, label = connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)
    return np.asarray(label[faces[:, 0]], np.int64)


def indexed(part: Part) -> Mesh:
    """One mesh with shared vertices, and normals that are smooth up to the crease angle."""
    normals = corner_normals(part.xyz).reshape(-1, 3)
    given = part.normals.reshape(-1, 3)
    length = np.linalg.norm(given, axis=1, keepdims=True)
    given = given / np.maximum(length, 1e-9)
    good = (length[:, 0] > 0.5) & ((given * normals).sum(axis=1) > 0.7)
    normals = np.where(good[:, None], given, normals)
    corners = np.concatenate((part.xyz.reshape(-1, 3), normals, part.uv.reshape(-1, 2)), axis=1)
    rounded = np.round(corners * ([1e5] * 3 + [50] * 3 + [1e5] * 2))
    _, first, inverse = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    v = corners[first].astype(np.float32)
    n = v[:, 3:6] / np.linalg.norm(v[:, 3:6], axis=1, keepdims=True)
    faces = inverse.reshape(-1, 3).astype(np.uint32)
    return Mesh(v[:, :3].copy(), n, v[:, 6:].copy(), faces, part.material)


def corner_normals(xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Normal at each corner: area-weighted mean over the faces there that bend less than the crease angle."""
    weighted = face_vectors(xyz)
    unit = weighted / np.maximum(np.linalg.norm(weighted, axis=1, keepdims=True), 1e-15)
    _, place = np.unique(np.round(xyz.reshape(-1, 3), 5), axis=0, return_inverse=True)
    place = place.ravel()
    order = np.argsort(place, kind="stable")
    counts = np.bincount(place)
    starts = np.concatenate(([0], np.cumsum(counts)[:-1]))
    mine = np.repeat(np.arange(len(place)), counts[place])  # each corner, beside all corners at its place
    offset = np.arange(len(mine)) - np.repeat(np.cumsum(counts[place]) - counts[place], counts[place])
    other = order[np.repeat(starts[place], counts[place]) + offset]
    near = (unit[mine // 3] * unit[other // 3]).sum(axis=1) > np.cos(CREASE_RAD)
    total = np.zeros((len(place), 3))
    for axis in range(3):
        total[:, axis] = np.bincount(mine, weights=near * weighted[other // 3, axis], minlength=len(place))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    total = np.where(length > 1e-15, total / np.maximum(length, 1e-15), np.repeat(unit, 3, axis=0))
    return total.reshape(-1, 3, 3)


def face_vectors(xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Twice the area times the normal of each triangle."""
    return np.asarray(np.cross(xyz[:, 1] - xyz[:, 0], xyz[:, 2] - xyz[:, 0]))


def _without_slivers(part: Part) -> Part:
    return part.only(np.linalg.norm(face_vectors(part.xyz), axis=1) > 1e-10)


def _without_slivers_all(parts: list[Part]) -> list[Part]:
    return [part for part in (_without_slivers(part) for part in parts) if len(part.xyz)]


def _without_hidden(parts: list[Part]) -> list[Part]:
    """Without connected pieces that cannot be seen from anywhere outside."""
    xyz = np.concatenate([part.xyz for part in parts])
    front, back = seen_pixels(xyz)
    component = components(xyz)
    seen = (np.bincount(component, weights=front + back) > 0)[component]
    cuts = np.cumsum([len(part.xyz) for part in parts])[:-1]
    kept = [part.only(keep) for part, keep in zip(parts, np.split(seen, cuts), strict=True)]
    return [part for part in kept if len(part.xyz)]


def _flipped(part: Part, flip: NDArray[np.bool_]) -> Part:
    turn = flip[:, None, None]
    facing = np.where(turn, part.xyz[:, ::-1], part.xyz)
    normals = np.where(turn, part.normals[:, ::-1], part.normals)
    against = (normals * face_vectors(facing)[:, None]).sum(axis=2, keepdims=True) < 0
    uv = np.where(turn, part.uv[:, ::-1], part.uv)
    return Part(facing, np.where(against, -normals, normals), uv, part.material)
