"""Bake the chosen models of Debian's sweethome3d-furniture.

    dpkg -x sweethome3d-furniture_1.8-1_all.deb DEB
    python -m tools.bake_assets.sweethome3d DEB/usr/share/sweethome3d/furniture OUT [NAME ...]

NAME: bake only these models (to try something). OUT gets one bundle for each group of selection.py.
"""

import hashlib
import re
import sys
import tempfile
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.synth.asset_entries import Source
from swardmap.synth.model import Material, Mesh, Texture
from swardmap.synth.shapes import moved, placed
from tools.bake_assets.bundle import BundleWriter
from tools.bake_assets.selection import BUNDLES, Choice
from tools.bake_assets.shaping import Part, cleaned
from tools.bake_assets.wavefront import Paint, read_obj

PACKAGE = "sweethome3d-furniture 1.8-1 (Debian)"
LICENCES = {
    "BlendSwap-CC-0": "CC0-1.0", "BlendSwap-CC-BY": "CC-BY-3.0", "KatorLegaz": "CC-BY-3.0-US",
    "Reallusion": "CC-BY-3.0-US", "Scopia": "CC-BY-3.0",
}  # fmt: skip
CHANGES = "converted, simplified, textures reduced"
FRONT_TO_X = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
"""From y up and front at +z to z up and front at +x."""
MAX_TEXTURE = 512
STONE = (0.40, 0.385, 0.35)
MUTE = 0.15
"""How far plain colours are drawn towards grey: nothing outdoors is as pure as the models' paints."""
GLASS = 0.75
"""Below this opacity a material is glass: of people it is left out (eyes), of things it becomes glossy."""


@dataclass(frozen=True, slots=True)
class Item:
    """A line of the catalogue, with the file of the model."""

    file: Path
    entry: dict[str, str]
    licence: str


def read_catalogue(folder: Path) -> dict[str, Item]:
    """All models of the unpacked .sh3f archives below a folder, by the name of their file."""
    items: dict[str, Item] = {}
    for pack in sorted(LICENCES):
        text = (folder / pack / "PluginFurnitureCatalog.properties").read_text(encoding="latin-1")
        entries: dict[int, dict[str, str]] = {}
        for key, number, value in re.findall(r"^(\w+)#(\d+)=(.*)$", text, re.MULTILINE):
            entries.setdefault(int(number), {})[key] = value.strip()
        for entry in entries.values():
            file = folder / pack / entry["model"].lstrip("/")
            items.setdefault(file.stem, Item(file, entry, LICENCES[pack]))
    return items


def bake(item: Item, choice: Choice, textures: dict[str, Texture]) -> list[Mesh]:
    """The meshes of a model, in the frame of models; its textures are added to `textures`."""
    soups = [soup for soup in read_obj(item.file) if len(soup.xyz)]
    turn = FRONT_TO_X @ np.array(item.entry.get("modelRotation", "1 0 0 0 1 0 0 0 1").split(), float).reshape(
        3, 3
    )
    points = np.concatenate([soup.xyz.reshape(-1, 3) for soup in soups]) @ turn.T
    low, high = points.min(axis=0), points.max(axis=0)
    wanted_m = np.array([float(item.entry[key]) / 100 for key in ("depth", "width", "height")]) * choice.scale
    scale = wanted_m / np.maximum(high - low, 1e-9)
    foot = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    parts = []
    for soup in soups:
        material = _material(soup.paint, choice, textures)
        if material is not None:
            parts.append(
                Part((soup.xyz @ turn.T - foot) * scale, soup.normals @ turn.T / scale, soup.uv, material)
            )
    yaw = placed(0, 0, 0, np.deg2rad(choice.yaw_deg))[:3, :3]
    parts = [replace(part, xyz=part.xyz @ yaw.T, normals=_unit(part.normals @ yaw.T)) for part in parts]
    meshes = on_ground(cleaned(parts, choice.triangles))
    if choice.kind == "person" or choice.stone:  # hair, skirts and jackets are sheets that meet closed bodies
        meshes = [replace(mesh, material=replace(mesh.material, cutout=True)) for mesh in meshes]
    return on_ground(at_rest(meshes)) if choice.pose == "lying" else meshes


def at_rest(meshes: list[Mesh]) -> list[Mesh]:
    """Tilted about y until what lies below the middle touches the ground at two places."""
    xyz = np.concatenate([mesh.xyz for mesh in meshes]).astype(np.float64)
    middle = xyz[:, 0].mean()
    hull: list[NDArray[np.float64]] = []
    for point in xyz[np.lexsort((xyz[:, 2], xyz[:, 0]))][:, [0, 2]]:  # lower hull, from back to front
        while len(hull) > 1 and np.linalg.det([hull[-1] - hull[-2], point - hull[-2]]) <= 0:
            hull.pop()
        hull.append(point)
    k = next(k for k in range(1, len(hull)) if hull[k][0] >= middle)
    slope = np.arctan2(*(hull[k] - hull[k - 1])[::-1])
    turn = np.eye(4)
    turn[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(slope), np.sin(slope), -np.sin(slope), np.cos(slope)
    return [moved(mesh, turn) for mesh in meshes]


def on_ground(meshes: list[Mesh]) -> list[Mesh]:
    """Moved so that the lowest point lies at z = 0."""
    low = min(float(mesh.xyz[:, 2].min()) for mesh in meshes)
    return [replace(mesh, xyz=mesh.xyz - np.array([0, 0, low], np.float32)) for mesh in meshes]


def source_of(item: Item) -> Source:
    """Title, author, licence and package, from the catalogue."""
    author = item.entry.get("creator", "unknown")
    return Source(item.entry["name"], author, item.licence, PACKAGE, CHANGES)


def name_of(choice: Choice) -> str:
    """The name in the bundle: lower case with dashes."""
    return choice.name or re.sub(r"(?<=[a-z])(?=[A-Z])", "-", choice.model).replace("_", "-").lower()


def _material(paint: Paint, choice: Choice, textures: dict[str, Texture]) -> Material | None:
    if paint.opacity < GLASS and (choice.kind == "person" or choice.stone):
        return None
    if choice.stone:
        return Material(STONE, roughness=0.9)
    glossy = 0.5 if paint.opacity < GLASS else min(paint.shine, 0.5) * 0.4
    leafy = choice.kind in ("tree", "shrub", "hedge", "flowers", "planter")
    if paint.texture is None:
        linear = np.clip(paint.color, 0.08, 0.92) ** 2.2
        r, g, b = (float(value) for value in MUTE * linear.mean() + (1 - MUTE) * linear)
        if paint.opacity < GLASS and choice.kind == "car":
            r = g = b = 0.02
        return Material((r, g, b), None, False, 0.0, glossy, 0.4 if glossy > 0.3 else 0.8)
    texture = _texture(paint.texture, textures)
    holes = bool((texture.rgba[..., 3] < 100).mean() > 0.005)
    return Material((1.0, 1.0, 1.0), texture, holes, 0.4 if holes and leafy else 0.0, glossy, 0.8)


def _texture(file: Path, textures: dict[str, Texture]) -> Texture:
    content = file.read_bytes()
    key = hashlib.sha256(content).hexdigest()
    if key not in textures:
        stem = re.sub(r"[^a-z0-9]+", "-", file.stem.lower()).strip("-")[:40]
        textures[key] = Texture(f"{stem}-{key[:6]}", prepared(rgba_of(file)))
    return textures[key]


def rgba_of(file: Path) -> NDArray[np.uint8]:
    """H x W x 4 of a picture file."""
    from PIL import Image  # reads every format that the catalogue has

    with Image.open(file) as image:
        return np.asarray(image.convert("RGBA"))


def prepared(rgba: NDArray[np.uint8], largest: int = MAX_TEXTURE) -> NDArray[np.uint8]:
    """At most so many pixels wide and high, with the colour of leaves bled into the holes around them."""
    shrink = largest / max(rgba.shape[:2])
    alpha = rgba[..., 3:].astype(np.float32) / 255
    weighted = np.concatenate((rgba[..., :3] * np.maximum(alpha, 1e-3), np.maximum(alpha, 1e-3)), axis=2)
    if shrink < 1:
        size = tuple(max(round(n * shrink), 1) for n in rgba.shape[1::-1])
        weighted = cv2.resize(weighted.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    color, cover = weighted[..., :3], weighted[..., 3:]
    if cover.min() < 0.5:
        spread = weighted.copy()
        for _ in range(7):  # wider and wider; near texels count most
            wide = cv2.blur(spread, (9, 9))
            spread = np.where(cover > 0.5, weighted, wide / np.maximum(wide[..., 3:], 1e-6) * 0.9)
        color = np.where(cover > 0.5, color / cover, spread[..., :3] / np.maximum(spread[..., 3:], 1e-6))
    else:
        color = color / cover
    alpha8 = np.maximum(np.rint(cover * 255), 1)  # WebP forgets the colour where alpha is 0
    done = np.clip(np.rint(np.concatenate((color, alpha8), axis=2)), 0, 255)
    return np.asarray(done, np.uint8)


def _unit(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.where(length > 1e-9, normals / np.maximum(length, 1e-9), 0.0)


def add_texture(bundle: BundleWriter, texture: Texture, source: Source) -> None:
    """Add the texture of a model, without alpha where it has no holes."""
    opaque = bool((texture.rgba[..., 3] >= 250).all())
    bundle.add_texture(texture.name, texture.rgba[..., : 3 if opaque else 4], "skin", source, quality=80)


def main() -> None:
    """Bake all bundles, or the named models."""
    folder, out, only = Path(sys.argv[1]), Path(sys.argv[2]), set(sys.argv[3:])
    with tempfile.TemporaryDirectory() as unpacked:
        for pack in LICENCES:
            with zipfile.ZipFile(folder / f"{pack}.sh3f") as archive:
                archive.extractall(Path(unpacked) / pack)
        items = read_catalogue(Path(unpacked))
        textures: dict[str, Texture] = {}
        done: set[str] = set()
        for group, choices in BUNDLES.items():
            bundle = BundleWriter()
            for choice in choices:
                if only and choice.model not in only:
                    continue
                meshes, source = bake(items[choice.model], choice, textures), source_of(items[choice.model])
                used = {m.material.texture.name: m.material.texture for m in meshes if m.material.texture}
                for name in sorted(set(used) - done):
                    add_texture(bundle, used[name], source)
                done |= set(used)
                bundle.add_model(
                    name_of(choice), meshes, choice.kind, source, choice.pose, choice.seat_m, choice.tags
                )
                print(group, name_of(choice), sum(len(mesh.faces) for mesh in meshes), len(meshes))
            print(group, bundle.write(out / f"{group}.zip"), "bytes")


if __name__ == "__main__":
    main()
