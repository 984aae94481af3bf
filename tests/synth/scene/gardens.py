"""Shared by the tests of scenes: gardens with the shipped assets, built once; where their vertices are."""

import json
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.synth.model import Float64Array, Garden, Thing
from swardmap.synth.scene.garden import build_garden
from swardmap.synth.terrain import Terrain
from tests.synth.people.bodies import assets

SEEDS = range(6)
OUTLINES = Path(__file__).parent / "outlines.json"
STAMPS_NS = range(0, 6_000_000_000, 700_000_000)


@cache
def garden(seed: int) -> Garden:
    return build_garden(seed, assets())


@cache
def plain_garden(seed: int) -> Garden:
    """Without assets."""
    return build_garden(seed)


def vertices(thing: Thing) -> Float64Array:
    """n x 3, in the map."""
    xyz = np.concatenate([mesh.xyz for mesh in thing.model.meshes]).astype(np.float64)
    out: Float64Array = xyz @ thing.T_map_model[:3, :3].T + thing.T_map_model[:3, 3]
    return out


def heights_m(thing: Thing, ground: Terrain) -> tuple[Float64Array, Float64Array]:
    """Above the ground: of all vertices, and of those within 1.5 cm of the model's lowest."""
    at = vertices(thing)
    z = np.concatenate([mesh.xyz[:, 2] for mesh in thing.model.meshes])
    over = at[:, 2] - ground.height_at(at[:, :2])
    return over, over[z <= z.min() + 0.015]


def digest(of: Garden) -> str:
    """SHA-256 over all that a garden is."""
    found = sha256()
    ground = of.ground
    for raster in (ground.height_m, ground.lawn_m, ground.surface, ground.albedo, ground.blade_height_m,
                   ground.blade_density, ground.dryness, of.lot_m):  # fmt: skip
        found.update(np.ascontiguousarray(raster).tobytes())
    for stamp_ns in (0, 1_234_567_890):
        for thing in of.at(stamp_ns):
            found.update(
                f"{thing.kind} {thing.pose} {thing.label.name} {thing.tint} {thing.model.name}".encode()
            )
            found.update(thing.T_map_model.tobytes())
            for mesh in thing.model.meshes:
                found.update(mesh.xyz.tobytes() + mesh.faces.tobytes() + mesh.normals.tobytes())
                found.update(mesh.uv.tobytes() + repr(mesh.material.color).encode())
                if mesh.material.texture is not None:
                    found.update(mesh.material.texture.rgba.tobytes())
    return found.hexdigest()


def outline(of: Garden) -> dict[str, Any]:
    """What another machine must find too, to the millimetre: what stands where, and heights of the ground."""
    low, high = of.lot_m.min(axis=0), of.lot_m.max(axis=0)
    spots = np.array([low + (high - low) * (a, b) for a in (0.1, 0.5, 0.9) for b in (0.1, 0.5, 0.9)])
    return {
        "things": [[t.kind, *np.round(t.T_map_model[:3, 3], 4).tolist()] for t in of.at(1_000_000_000)],
        "heights_m": np.round(of.ground.height_at(spots), 4).tolist(),
        "lawn_m2": round(float((of.ground.lawn_m > 0).sum()) * of.ground.texel_m**2, 2),
    }


if __name__ == "__main__":  # after gardens were changed on purpose
    written = {"2": outline(garden(2)), "plain 1": outline(plain_garden(1))}
    OUTLINES.write_text("{\n" + ",\n".join(f'"{k}": {json.dumps(v)}' for k, v in written.items()) + "\n}\n")
