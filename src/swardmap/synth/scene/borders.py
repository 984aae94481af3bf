"""What runs along lines: fences, hedges and walls, in pieces that step down slopes; and the buildings."""

import numpy as np

from swardmap.synth.model import Float64Array, Model, Thing
from swardmap.synth.scene.lot import Lot
from swardmap.synth.scene.materials import leaves
from swardmap.synth.scene.place import Footprint, Occupancy, footprint_of, upright
from swardmap.synth.scene.plants import hedge_part
from swardmap.synth.scene.structures import FENCE_STYLES, fence_part, house, shed, wall_part
from swardmap.synth.terrain import Surface, Terrain

MAX_STEP_M = 0.11  # between the ends of a piece; more of it would stick out of the slope or hang over it
WAYS = (Surface.GRAVEL, Surface.PAVING, Surface.DIRT, Surface.CONCRETE, Surface.WATER)
INSET_M = {"hedge": 0.45, "wall": 0.2}


def buildings(lot: Lot, ground: Terrain, taken: Occupancy, rng: np.random.Generator) -> list[Thing]:
    """House and shed of the plan."""
    things = []
    for kind, box, build in (("house", lot.house, house), ("shed", lot.shed, shed)):
        if box is not None:
            model = build(rng, box.half_m)
            T = upright(ground, model, box.center_m, box.yaw_rad, sink_m=0.02)
            taken.take(footprint_of(model, box.center_m, box.yaw_rad, below_m=1.0))
            things.append(Thing(model, kind, T))
    return things


def edgings(lot: Lot, ground: Terrain, taken: Occupancy, rng: np.random.Generator) -> list[Thing]:
    """What stands on the outline of the lot, and lines within it; ways and buildings are left open."""
    things: list[Thing] = []
    for k, kind in enumerate(lot.edges):
        start, end = lot.corners_m[k], lot.corners_m[(k + 1) % len(lot.corners_m)]
        along = (end - start) / np.linalg.norm(end - start)
        inward = np.array([-along[1], along[0]]) * INSET_M.get(kind, 0.08)
        skip = along * (INSET_M.get(kind, 0.08) + 0.05)
        if kind != "open":
            things += _line(kind, start + inward + skip, end + inward - skip, ground, taken, rng)
    for kind, a, b in lot.extra_lines:
        things += _line(kind, np.asarray(a), np.asarray(b), ground, taken, rng)
    return things


def _line(
    kind: str, start: Float64Array,
    end: Float64Array, ground: Terrain, taken: Occupancy,
    rng: np.random.Generator,
) -> list[Thing]:  # fmt: skip
    """Equal pieces from start to end, where nothing is in the way."""
    length = float(np.linalg.norm(end - start))
    yaw = float(np.arctan2(*(end - start)[::-1]))
    count = max(1, int(np.ceil(length / _piece_m(ground, start, end, length))))
    models = _models(kind, length / count, rng)
    things = []
    for k, pick in enumerate(rng.integers(0, len(models), count)):
        x, y = start + (end - start) * (k + 0.5) / count
        depth = footprint_of(models[pick], (0, 0), 0.0).half_m[1]
        narrow = Footprint((float(x), float(y)), (length / count / 2 - 0.01, depth), yaw)  # pieces may touch
        if taken.gap_m(narrow) > 0.0 and not _on_a_way(ground, x, y):
            things.append(Thing(models[pick], kind, upright(ground, models[pick], (x, y), yaw)))
            taken.take(narrow)
    return things


def _models(kind: str, piece_m: float, rng: np.random.Generator) -> list[Model]:
    """Some different pieces of one line."""
    height, style = rng.uniform(0.8, 1.8), str(rng.choice(FENCE_STYLES))
    if kind == "hedge":
        foliage = leaves(rng, 0.04)
        return [hedge_part(rng, piece_m + 0.05, 0.6, height, foliage) for _ in range(2)]
    if kind == "wall":
        return [wall_part(rng, piece_m, min(height, 1.3), bool(rng.random() < 0.5))]
    if kind in ("wire", "railing"):
        return [fence_part(rng, piece_m, kind, min(height, 1.3))]
    return [fence_part(rng, piece_m, style, height)]


def _piece_m(
    ground: Terrain, start: Float64Array,
    end: Float64Array, length: float,
) -> float:  # fmt: skip
    """Longest piece, 0.5-2 m, whose ends differ by no more than a step on the steepest metre of the line."""
    t = np.linspace(0, 1, max(3, int(length / 0.5)))[:, None]
    z = ground.height_at(start + t * (end - start))
    steepest = float(np.abs(np.diff(z)).max() / (length / (len(t) - 1)))
    return float(np.clip(MAX_STEP_M / max(steepest, 1e-3), 0.5, 2.0))


def _on_a_way(ground: Terrain, x: float, y: float) -> bool:
    at = np.floor((np.array([x, y]) - ground.origin_m) / ground.texel_m).astype(int)
    j, i = np.clip(at[::-1], 0, np.array(ground.surface.shape) - 1)
    return bool(ground.lawn_m[j, i] < 0 and ground.surface[j, i] in WAYS)
