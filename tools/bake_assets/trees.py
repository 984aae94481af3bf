"""Bake the trees and bushes that gen_trees.mjs grew with ez-tree.

npm install @dgreenheck/ez-tree@1.1.0 && node gen_trees.mjs GROWN
python -m tools.bake_assets.trees GROWN node_modules/@dgreenheck/ez-tree OUT
"""

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.io.images import decode
from swardmap.synth.asset_entries import Source
from swardmap.synth.model import Material, Mesh, Texture
from swardmap.synth.shapes import mesh_of
from tools.bake_assets.bundle import BundleWriter
from tools.bake_assets.sweethome3d import add_texture, on_ground, prepared

PACKAGE = "@dgreenheck/ez-tree 1.1.0 (npm)"
MIT = Source("EZ-Tree", "Daniel Greenheck", "MIT", PACKAGE, "grown with fewer, larger leaves")
BARK = {  # the README of the package names the pages; both sites give everything under CC0
    "birch": Source("birch bark", "texturecan.com (details/221)", "CC0-1.0", PACKAGE, "reduced"),
    "pine": Source("pine bark", "texturecan.com (details/588)", "CC0-1.0", PACKAGE, "reduced"),
    "oak": Source("bark_brown_02", "polyhaven.com", "CC0-1.0", PACKAGE, "reduced"),
    "willow": Source("bark_willow_02", "polyhaven.com", "CC0-1.0", PACKAGE, "reduced"),
}
LEAF = Source("leaves", "Daniel Greenheck", "MIT", PACKAGE, "reduced, colours bled into the holes")
HEIGHT_M = {
    "Oak Large": 10.0, "Oak Medium": 7.0, "Oak Small": 4.0, "Ash Large": 11.0, "Ash Medium": 7.5,
    "Ash Small": 4.0, "Aspen Large": 11.0, "Aspen Medium": 7.0, "Aspen Small": 4.0,
    "Pine Large": 11.0, "Pine Medium": 7.0, "Pine Small": 3.5, "Bush 1": 1.3, "Bush 2": 1.1, "Bush 3": 1.4,
}  # fmt: skip
LEAF_ALBEDO = {  # linear RGB of whole leaves, as foliage measures: dark, green a little above red
    "oak": (0.075, 0.125, 0.030), "ash": (0.085, 0.140, 0.035), "aspen": (0.130, 0.175, 0.030),
    "pine": (0.045, 0.080, 0.028),
}  # fmt: skip
BARK_ALBEDO = {"oak": 0.13, "birch": 0.42, "pine": 0.15, "willow": 0.17}
Y_UP_TO_Z_UP = np.array([[1, 0, 0], [0, 0, -1.0], [0, 1, 0]])


def bake_tree(grown: Path, tree: dict[str, Any], textures: dict[str, Texture]) -> list[Mesh]:
    """Branches and leaves of a tree, in metres."""
    branches, leaves = (_raw(grown, tree["name"], part) for part in ("branches", "leaves"))
    top = max(float(branches["p"][:, 2].max()), float(leaves["p"][:, 2].max()))
    scale = HEIGHT_M[tree["preset"]] / top
    bark, leaf = textures[f"bark-{tree['bark']}"], textures[f"leaf-{tree['leaf']}"]
    grey = BARK_ALBEDO[tree["bark"]] / float(mean_linear(bark).mean())
    uv = branches["u"] * [tree["scale"]["x"], 1 / tree["scale"]["y"]]
    normals = branches["n"] / np.linalg.norm(branches["n"], axis=1, keepdims=True)
    wood = Material((min(grey, 1.0),) * 3, bark, roughness=0.9)
    color = np.minimum(np.array(LEAF_ALBEDO[tree["leaf"]]) / mean_linear(leaf), 1.0)
    r, g, b = (float(value) for value in color)
    green = Material((r, g, b), leaf, cutout=True, translucency=0.45, specular=0.08, roughness=0.6)
    return on_ground(
        [
            mesh_of(branches["p"] * scale, normals, uv, branches["i"], wood),
            mesh_of(leaves["p"] * scale, puffy(leaves["p"], leaves["n"]), leaves["u"], leaves["i"], green),
        ]
    )


def puffy(xyz: NDArray[Any], normals: NDArray[Any]) -> NDArray[Any]:
    """Normals of leaves bent away from the middle of the crown, so that the crown is lit like a solid."""
    away = xyz - xyz.mean(axis=0) * [1, 1, 0.8]
    away /= np.linalg.norm(away, axis=1, keepdims=True) + 1e-9
    mixed = 0.4 * normals + 0.8 * away
    return np.asarray(mixed / np.maximum(np.linalg.norm(mixed, axis=1, keepdims=True), 1e-6))


def mean_linear(texture: Texture) -> NDArray[np.float64]:
    """Mean linear RGB of the texels that are not holes."""
    solid = texture.rgba[texture.rgba[..., 3] > 100][:, :3] / 255.0
    linear: NDArray[np.float64] = (solid**2.2).mean(axis=0)
    return linear


def _raw(grown: Path, name: str, part: str) -> dict[str, NDArray[Any]]:
    raw: dict[str, NDArray[Any]] = {}
    for key, width, kind in (("p", 3, "<f4"), ("n", 3, "<f4"), ("u", 2, "<f4"), ("i", 3, "<u4")):
        raw[key] = np.fromfile(grown / f"{name}_{part}_{key}.bin", kind).reshape(-1, width)
    return {**raw, "p": raw["p"] @ Y_UP_TO_Z_UP.T, "n": raw["n"] @ Y_UP_TO_Z_UP.T}


def _pictures(assets: Path) -> dict[str, Texture]:
    textures = {}
    for name, file in (
        *((f"bark-{kind}", assets / "bark" / f"{kind}_color_1k.jpg") for kind in BARK),
        *((f"leaf-{kind}", assets / "leaves" / f"{kind}_color.png") for kind in LEAF_ALBEDO),
    ):
        image = decode(file.read_bytes(), str(file))
        rgba = cv2.cvtColor(image, cv2.COLOR_BGRA2RGBA if image.shape[2] == 4 else cv2.COLOR_BGR2RGBA)
        textures[name] = Texture(name, prepared(np.asarray(rgba, np.uint8), 512))
    return textures


def main() -> None:
    """Write trees.zip."""
    grown, package, out = (Path(argument) for argument in sys.argv[1:4])
    textures, bundle = _pictures(package / "src" / "lib" / "assets"), BundleWriter()
    for name, texture in textures.items():
        add_texture(bundle, texture, BARK[name[5:]] if name.startswith("bark-") else LEAF)
    for tree in json.loads((grown / "trees.json").read_text()):
        meshes = bake_tree(grown, tree, textures)
        kind = "shrub" if tree["preset"].startswith("Bush") else "tree"
        tags = ("conifer",) if tree["leaf"] == "pine" else ("deciduous",)
        bundle.add_model(tree["name"], meshes, kind, MIT, tags=tags)
        print(tree["name"], tree["triangles"])
    print(bundle.write(out / "trees.zip"), "bytes")


if __name__ == "__main__":
    main()
