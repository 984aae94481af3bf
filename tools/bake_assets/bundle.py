"""Write a bundle of garden assets, in the format of `swardmap.synth.asset_bundle`.

    bundle = BundleWriter()
    bundle.add_texture("bark-oak", rgba, "skin", source)
    bundle.add_model("oak-1", meshes, "tree", source)
    bundle.add_arrays("skeleton", {"joints": joints}, source)
    bundle.write(Path("garden_assets/swardmap_garden_assets/trees.zip"))

The same content gives the same bytes: members have a fixed date and order.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.io.files import write_bytes
from swardmap.synth.asset_bundle import FORMAT, NAME, packed_normals, quantised
from swardmap.synth.asset_entries import Source
from swardmap.synth.model import Mesh

LONG_AGO = (1980, 1, 1, 0, 0, 0)


class BundleWriter:
    """Collects assets, then writes them as one zip file."""

    def __init__(self) -> None:
        self._index: dict[str, Any] = {"format": FORMAT, "models": {}, "textures": {}, "arrays": {}}
        self._members: dict[str, bytes] = {}

    def add_model(
        self, name: str, meshes: Sequence[Mesh], kind: str, source: Source,
        pose: str = "", seat_m: float = 0.0, tags: Sequence[str] = (),
    ) -> None:  # fmt: skip
        """Add a shape; its textures are added apart, under the names that its materials' textures have.

        Args:
            name: unique, of letters, digits, dot, dash and underscore.
            meshes: in the frame of a model (z up, +x front, on z = 0), metres.
            kind: such as tree; see swardmap.synth.assets.ModelEntry, also for the rest.
            source: for the attribution.
            pose: of a person or animal.
            seat_m: height of the seat beneath a person who sits.
            tags: such as child, female, conifer.
        """
        meshes = [_in_order_of_use(mesh) for mesh in meshes if len(mesh.faces)]
        xyz = np.concatenate([mesh.xyz for mesh in meshes])
        low, high = xyz.min(axis=0).tolist(), xyz.max(axis=0).tolist()
        arrays: dict[str, NDArray[Any]] = {}
        indices = []
        for k, mesh in enumerate(meshes):
            uv_low, uv_high = mesh.uv.min(axis=0).tolist(), mesh.uv.max(axis=0).tolist()
            arrays[f"{k}.xyz"] = quantised(mesh.xyz, low, high)
            arrays[f"{k}.normals"] = packed_normals(mesh.normals)
            arrays[f"{k}.uv"] = quantised(mesh.uv, uv_low, uv_high)
            arrays[f"{k}.faces"] = _differences(mesh.faces.reshape(-1).astype(np.int64))
            indices.append({"uv_low": uv_low, "uv_high": uv_high, "material": _material_index(mesh)})
        entry = {
            "kind": kind, "low_m": low, "high_m": high, "triangles": sum(len(mesh.faces) for mesh in meshes),
            "pose": pose, "seat_m": seat_m, "tags": list(tags), "meshes": indices,
        }  # fmt: skip
        self._add("models", name, "npz", npz_bytes(arrays), {**entry, "source": asdict(source)})

    def add_texture(
        self, name: str, rgba: NDArray[np.uint8], kind: str, source: Source,
        tile_m: tuple[float, float] = (0.0, 0.0), quality: int = 85,
    ) -> None:  # fmt: skip
        """Add a texture as WebP.

        Args:
            name: unique, of letters, digits, dot, dash and underscore.
            rgba: H x W x 4 or 3, sRGB.
            kind: such as gravel, or `skin` if it belongs to a model.
            source: for the attribution.
            tile_m: how far it reaches before it repeats (width, height); 0 = it does not.
            quality: of WebP, 1..100.
        """
        order = [2, 1, 0, 3][: rgba.shape[2]]
        done, content = cv2.imencode(
            ".webp", np.ascontiguousarray(rgba[..., order]), [cv2.IMWRITE_WEBP_QUALITY, quality]
        )
        if not done:
            raise ValueError(f"texture {name}: cannot be encoded, {rgba.shape}")
        index = {"kind": kind, "tile_m": list(tile_m), "source": asdict(source)}
        self._add("textures", name, "webp", content.tobytes(), index)

    def add_arrays(self, name: str, arrays: Mapping[str, NDArray[Any]], source: Source) -> None:
        """Add a set of arrays, as they are; no array of objects."""
        self._add("arrays", name, "npz", npz_bytes(arrays), {"source": asdict(source)})

    def write(self, path: Path) -> int:
        """Write the bundle; returns its size in bytes."""
        index = json.dumps(self._index, sort_keys=True, separators=(",", ":")).encode()
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w") as bundle:
            deflated = zipfile.ZIP_DEFLATED
            bundle.writestr(zipfile.ZipInfo("index.json", LONG_AGO), index, deflated, 9)
            for name, content in sorted(self._members.items()):
                bundle.writestr(zipfile.ZipInfo(name, LONG_AGO), content, zipfile.ZIP_STORED)
        write_bytes(path, buffer.getvalue())
        return len(buffer.getvalue())

    def _add(self, part: str, name: str, ending: str, content: bytes, index: dict[str, Any]) -> None:
        if not NAME.fullmatch(name) or name in self._index[part]:
            raise ValueError(f"expected a plain new name of an asset, got {name!r}")
        self._members[f"{part}/{name}.{ending}"] = content
        self._index[part][name] = {**index, "sha256": hashlib.sha256(content).hexdigest()}


def npz_bytes(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Arrays as .npz, packed as tightly as np.load can read."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in sorted(arrays.items()):
            member = io.BytesIO()
            np.lib.format.write_array(member, np.ascontiguousarray(array), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", LONG_AGO)
            archive.writestr(info, member.getvalue(), zipfile.ZIP_LZMA)
    return buffer.getvalue()


def _in_order_of_use(mesh: Mesh) -> Mesh:
    """The same mesh with its vertices in the order in which faces name them, without unused ones."""
    used, first, inverse = np.unique(mesh.faces.reshape(-1), return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.uint32)
    rank[order] = np.arange(len(order), dtype=np.uint32)
    keep = used[order]
    faces = rank[inverse].reshape(-1, 3)
    return Mesh(mesh.xyz[keep], mesh.normals[keep], mesh.uv[keep], faces, mesh.material)


def _differences(values: NDArray[np.int64]) -> NDArray[Any]:
    """Differences from the one before, in the smallest signed type that holds them."""
    steps = np.concatenate((values[:1], values[1:] - values[:-1]))
    low, high = int(steps.min()), int(steps.max())
    return steps.astype(np.result_type(np.min_scalar_type(-max(high, -low, 1) - 1), np.int8))


def _material_index(mesh: Mesh) -> dict[str, Any]:
    material = mesh.material
    return {
        "color": [round(float(value), 5) for value in material.color],
        "texture": material.texture.name if material.texture else "",
        "cutout": material.cutout,
        "translucency": material.translucency,
        "specular": material.specular,
        "roughness": material.roughness,
    }
