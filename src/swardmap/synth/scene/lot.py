"""The plan of a lot: its outline, the house, what of it is not lawn."""

from dataclasses import dataclass

import numpy as np

from swardmap.synth.model import Float64Array
from swardmap.synth.scene.areas import Area, Blob, Rectangle, Strip, curve
from swardmap.synth.terrain import Surface

EDGINGS = ("fence", "hedge", "wall", "wire", "open")


@dataclass(frozen=True, slots=True, eq=False)
class Lot:
    """Where everything big goes.

    Attributes:
        corners_m: k x 2, counter-clockwise, convex.
        edges: what stands on each edge: one of EDGINGS.
        house, shed: their walls; None = none.
        terrace: in front of the house.
        areas: all that is not lawn; the later one lies on top.
        flats: parts that were levelled, each with the way over which it meets the land around, metres.
        extra_lines: free-standing fences and hedges, each as (kind, start, end).
    """

    corners_m: Float64Array
    edges: tuple[str, ...]
    house: Rectangle | None
    shed: Rectangle | None
    terrace: Rectangle | None
    areas: tuple[Area, ...]
    flats: tuple[tuple[Rectangle, float], ...]
    extra_lines: tuple[tuple[str, tuple[float, float], tuple[float, float]], ...]


def plan_lot(rng: np.random.Generator, cover: float = 1.0) -> Lot:
    """A lot of 12-40 m with a house or none, paths, beds and what else breaks the lawn.

    Args:
        rng: of the lot.
        cover: how many times as likely a bed is one of ground cover.
    """
    corners = _outline(rng)
    edges = tuple(str(rng.choice(EDGINGS, p=(0.38, 0.24, 0.12, 0.1, 0.16))) for _ in corners)
    house, terrace = _house(rng, corners)
    shed = _shed(rng, corners, house, terrace)
    areas: list[Area] = [
        *_beds(rng, corners, cover),
        *_islands(rng, corners, cover),
        *_paths(rng, corners, terrace),
    ]
    if terrace is not None:
        paved = rng.choice([Surface.PAVING, Surface.CONCRETE, Surface.WOOD])
        areas.append(Area(terrace, Surface(int(paved)), 0.004))
    built = [box for box in (house, shed) if box is not None]
    areas += [Area(_grown(box, 0.12), Surface.CONCRETE, 0.004) for box in built]
    flats = [(_grown(box, 0.35), 3.5) for box in (*built, terrace) if box is not None]
    return Lot(corners, edges, house, shed, terrace, tuple(areas), tuple(flats), _lines(rng, corners))


def _outline(rng: np.random.Generator) -> Float64Array:
    """A rectangle with moved corners, at times one cut off; its box measures 12-40 m."""
    w, h = rng.uniform(12, 40), rng.uniform(12, 40)
    corners = np.array([(-w, -h), (w, -h), (w, h), (-w, h)]) / 2
    corners -= np.sign(corners) * rng.uniform(0, 0.09, (4, 2)) * [w, h]
    if rng.random() < 0.45:
        k, cut = int(rng.integers(4)), rng.uniform(0.15, 0.4, 2)
        before, here, after = corners[k - 1], corners[k], corners[(k + 1) % 4]
        corners = np.insert(np.delete(corners, k, axis=0), k, [here + cut[1] * (after - here)], axis=0)
        corners = np.insert(corners, k, here + cut[0] * (before - here), axis=0)
    wide: Float64Array = corners * np.clip(12.5 / np.ptp(corners, axis=0), 1, None)
    return wide


def _edge(corners: Float64Array, k: int) -> tuple[Float64Array, Float64Array, Float64Array, float]:
    """Start, direction, inward normal and length of an edge."""
    start, end = corners[k], corners[(k + 1) % len(corners)]
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    return start, along, np.array([-along[1], along[0]]), length


def _longest(corners: Float64Array) -> int:
    return int(np.argmax(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)))


def _house(rng: np.random.Generator, corners: Float64Array) -> tuple[Rectangle | None, Rectangle | None]:
    """A house at the longest edge, its terrace on the side of the garden; neither on a small lot."""
    start, along, inward, length = _edge(corners, _longest(corners))
    wanted, size = rng.random() < 0.8, rng.uniform((6, 4.5), (12, 7))
    t, out, paved = rng.random(), rng.uniform(0.6, 1.5), rng.uniform((3.0, 1.8), (6.0, 3.5))
    deep = float(np.min(np.ptp(corners, axis=0)))
    if not wanted or deep < 15 or length < size[0] + 4:
        return None, None
    yaw = float(np.arctan2(along[1], along[0]))
    at = start + along * (size[0] / 2 + 2 + t * (length - size[0] - 4)) + inward * (out + size[1] / 2)
    front = at + inward * (size[1] / 2 + paved[1] / 2)
    house = Rectangle(_xy(at), (float(size[0] / 2), float(size[1] / 2)), yaw)
    return house, Rectangle(_xy(front), (float(paved[0] / 2), float(paved[1] / 2)), yaw)


def _shed(
    rng: np.random.Generator, corners: Float64Array, house: Rectangle | None, terrace: Rectangle | None
) -> Rectangle | None:
    """A shed near a corner of the lot, away from the house."""
    wanted, size = rng.random() < 0.5, rng.uniform((1.6, 1.4), (3.0, 2.4))
    order = rng.permutation(len(corners))
    if not wanted:
        return None
    for k in order:
        start, along, inward, length = _edge(corners, int(k))
        at = start + along * min(2.6, length / 2) + inward * (size[1] / 2 + 1.2)
        box = Rectangle(
            _xy(at), (float(size[0] / 2), float(size[1] / 2)), float(np.arctan2(along[1], along[0]))
        )
        if all(_apart(box, other, 2.0) for other in (house, terrace) if other is not None):
            return box
    return None


def _with_cover(chances: tuple[float, ...], times: float) -> Float64Array:
    """Chances of surfaces, that of ground cover (the second) so many times as high against the others."""
    weights = np.array(chances)
    if times != 1:
        weights[1] *= times
        weights /= weights.sum()
    return weights


def _beds(rng: np.random.Generator, corners: Float64Array, cover: float) -> list[Area]:
    """Beds along edges: mulch, ground cover, soil."""
    beds = []
    for k in range(len(corners)):
        wanted, width, reach = rng.random() < 0.5, rng.uniform(0.5, 1.6), np.sort(rng.uniform(0.08, 0.92, 2))
        kinds = [Surface.MULCH, Surface.GROUND_COVER, Surface.DIRT]
        surface = rng.choice(kinds, p=_with_cover((0.55, 0.3, 0.15), cover))
        start, along, inward, length = _edge(corners, k)
        half = length * (reach[1] - reach[0]) / 2
        if wanted and half > 1.0:
            at = start + along * length * reach.mean() + inward * (width / 2 + 0.15)
            box = Rectangle(_xy(at), (float(half), float(width / 2)), float(np.arctan2(along[1], along[0])))
            beds.append(Area(box, Surface(int(surface)), float(rng.uniform(0.012, 0.05))))
    return beds


def _islands(rng: np.random.Generator, corners: Float64Array, cover: float) -> list[Area]:
    """Beds, ponds, sand and green carpets in the lawn."""
    kinds = [Surface.MULCH, Surface.GROUND_COVER, Surface.WATER, Surface.SAND, Surface.CARPET,
             Surface.LEAF_LITTER, Surface.DIRT, Surface.GRAVEL]  # fmt: skip
    chances = _with_cover((0.22, 0.17, 0.12, 0.08, 0.15, 0.1, 0.09, 0.07), cover)
    roomy = np.clip(np.ptp(corners, axis=0).min() / 18, 0.7, 1.5)
    found = []
    for _ in range(int(rng.integers(1, 5))):
        surface = Surface(int(rng.choice(kinds, p=chances)))
        at, yaw = _within(rng, corners, 0.62), float(rng.uniform(0, np.pi))
        half, wave, phase = (
            rng.uniform((0.6, 0.5), (2.2, 1.3)) * roomy,
            rng.uniform(0.03, 0.13),
            rng.uniform(0, 6.28),
        )
        shape: Rectangle | Blob = Blob(at, (float(half[0]), float(half[1])), yaw, float(wave), float(phase))
        if surface in (Surface.CARPET, Surface.SAND) and rng.random() < 0.7:
            shape = Rectangle(at, (float(half[0]), float(half[1])), yaw)
        sunk = {Surface.WATER: 0.07, Surface.SAND: 0.03, Surface.DIRT: 0.02}.get(surface, 0.0)
        rough = 0.004 if surface is Surface.CARPET else 0.015
        found.append(Area(shape, surface, rough, sunk))
    return found


def _paths(rng: np.random.Generator, corners: Float64Array, terrace: Rectangle | None) -> list[Area]:
    """Paths through the lot: from the terrace or an edge to another edge."""
    kinds = [Surface.GRAVEL, Surface.PAVING, Surface.DIRT, Surface.CONCRETE, Surface.MULCH]
    found = []
    for i in range(int(rng.choice([0, 1, 2], p=(0.12, 0.6, 0.28)))):
        surface = Surface(int(rng.choice(kinds, p=(0.26, 0.24, 0.3, 0.12, 0.08))))
        a, b = (int(k) for k in rng.choice(len(corners), 2, replace=False))
        t = rng.uniform(0.25, 0.75, 2)
        ends = [
            corners[k] + u * (corners[(k + 1) % len(corners)] - corners[k])
            for k, u in zip((a, b), t, strict=True)
        ]
        if terrace is not None and i == 0:
            ends[0] = np.asarray(terrace.center_m)
        way = ends[1] - ends[0]
        side = np.array([-way[1], way[0]])
        inner = [ends[0] + u * way + side * rng.uniform(-0.16, 0.16) for u in (0.3, 0.65)]
        line = curve(np.array([ends[0], *inner, ends[1] + 0.08 * way]), 5)
        width = float(rng.uniform(0.35, 0.8) if surface is Surface.DIRT else rng.uniform(0.6, 1.5))
        rough = {Surface.DIRT: 0.07, Surface.GRAVEL: 0.02, Surface.MULCH: 0.03}.get(surface, 0.005)
        sunk = 0.025 if surface is Surface.DIRT else 0.0
        found.append(Area(Strip(tuple(_xy(p) for p in line), width), surface, rough, sunk))
    return found


def _lines(
    rng: np.random.Generator, corners: Float64Array
) -> tuple[tuple[str, tuple[float, float], tuple[float, float]], ...]:
    """Short fences and hedges that stand free in the lot."""
    lines = []
    for _ in range(int(rng.integers(0, 3))):
        kind = str(rng.choice(["fence", "hedge", "railing", "wall"], p=(0.3, 0.35, 0.2, 0.15)))
        at, yaw, half = _within(rng, corners, 0.6), rng.uniform(0, np.pi), rng.uniform(1.0, 2.5)
        step = half * np.array([np.cos(yaw), np.sin(yaw)])
        lines.append((kind, _xy(at - step), _xy(at + step)))
    return tuple(lines)


def _within(rng: np.random.Generator, corners: Float64Array, share: float) -> tuple[float, float]:
    """A point of the lot shrunk towards its middle."""
    weights = rng.dirichlet(np.full(len(corners), 0.8))
    middle = corners.mean(axis=0)
    return _xy(middle + share / 0.62 * 0.8 * (weights @ corners - middle))


def _grown(box: Rectangle, by_m: float) -> Rectangle:
    return Rectangle(box.center_m, (box.half_m[0] + by_m, box.half_m[1] + by_m), box.yaw_rad)


def _apart(a: Rectangle, b: Rectangle, gap_m: float) -> bool:
    between = np.hypot(*np.subtract(a.center_m, b.center_m))
    return bool(between > np.hypot(*a.half_m) + np.hypot(*b.half_m) + gap_m)


def _xy(point: Float64Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])
