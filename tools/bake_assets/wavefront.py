"""Read Wavefront OBJ files with their materials, as triangles with one set of attributes for each corner."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Paint:
    """A material of an MTL file.

    Attributes:
        color: sRGB, 0..1.
        opacity: 1 = solid.
        texture: picture file, or None.
        shine: mean of Ks times illum's highlight, 0..1.
    """

    color: tuple[float, float, float] = (0.7, 0.7, 0.7)
    opacity: float = 1.0
    texture: Path | None = None
    shine: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Soup:
    """Triangles of one material, corner by corner.

    Attributes:
        xyz: m x 3 x 3.
        normals: m x 3 x 3; zero where the file has none.
        uv: m x 3 x 2.
        paint: its material.
    """

    xyz: NDArray[np.float64]
    normals: NDArray[np.float64]
    uv: NDArray[np.float64]
    paint: Paint


@dataclass(slots=True)
class _Lists:
    v: list[list[float]] = field(default_factory=list)
    vt: list[list[float]] = field(default_factory=list)
    vn: list[list[float]] = field(default_factory=list)
    faces: dict[str, list[tuple[int, ...]]] = field(default_factory=dict)


def read_obj(path: Path) -> list[Soup]:
    """All triangles of a file, by material; polygons become fans, in the file's own frame and unit."""
    lists, current = _Lists(), ""
    paints: dict[str, Paint] = {}
    for line in path.read_text(encoding="latin-1").replace("\\\n", " ").splitlines():
        word, _, rest = line.strip().partition(" ")
        if word == "v":
            lists.v.append([float(x) for x in rest.split()[:3]])
        elif word == "vt":
            lists.vt.append([float(x) for x in rest.split()[:2]])
        elif word == "vn":
            lists.vn.append([float(x) for x in rest.split()[:3]])
        elif word == "f":
            _add_face(lists, current, rest)
        elif word == "usemtl":
            current = rest.strip()
        elif word == "mtllib":
            paints |= read_mtl(_file_beside(path, rest.strip()))
    return [_soup(lists, corners, paints.get(name, Paint())) for name, corners in lists.faces.items()]


def read_mtl(path: Path | None) -> dict[str, Paint]:
    """Materials of an MTL file by name."""
    found: dict[str, dict[str, Any]] = {}
    entry: dict[str, Any] = {}
    for line in path.read_text(encoding="latin-1").splitlines() if path else ():
        word, _, rest = line.strip().partition(" ")
        if word == "newmtl":
            entry = found.setdefault(rest.strip(), {})
        elif word == "Kd":
            r, g, b = (float(x) for x in rest.split()[:3])
            entry["color"] = (r, g, b)
        elif word == "Ks":
            entry["shine"] = float(np.mean([float(x) for x in rest.split()[:3]]))
        elif word == "d":
            entry["opacity"] = float(rest.split()[-1])
        elif word == "Tr":
            entry.setdefault("opacity", 1 - float(rest.split()[-1]))
        elif word == "map_Kd" and path:
            entry["texture"] = _file_beside(path, rest.strip())
    return {name: Paint(**values) for name, values in found.items()}


def _add_face(lists: _Lists, material: str, text: str) -> None:
    corners = []
    for corner in text.split():
        v, vt, vn = ([*corner.split("/"), "", ""])[:3]
        corners.append((_index(v, lists.v), _index(vt, lists.vt), _index(vn, lists.vn)))
    triangles = lists.faces.setdefault(material, [])
    for k in range(1, len(corners) - 1):
        triangles.append((*corners[0], *corners[k], *corners[k + 1]))


def _index(text: str, values: list[list[float]]) -> int:
    number = int(text) if text else 0
    return number - 1 if number > 0 else len(values) + number if number < 0 else -1


def _soup(lists: _Lists, corners: list[tuple[int, ...]], paint: Paint) -> Soup:
    index = np.array(corners, np.int64).reshape(-1, 3, 3)
    v = np.array(lists.v, np.float64)
    vt = np.array([*lists.vt, [0, 0]], np.float64)  # the last one is what -1 points to
    vn = np.array([*lists.vn, [0, 0, 0]], np.float64)
    return Soup(v[index[..., 0]], vn[index[..., 2]], vt[index[..., 1]], paint)


def _file_beside(path: Path, name: str) -> Path | None:
    """A file named in another one, whatever the case of its letters."""
    wanted = name.replace("\\", "/").split("/")[-1].lower()
    return next((file for file in sorted(path.parent.iterdir()) if file.name.lower() == wanted), None)
