"""Ways over the ground, and who moves along them."""

from dataclasses import dataclass

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.labels import OTHER, PERSON, LabelClass
from swardmap.synth.model import Float64Array, Model, Thing
from swardmap.synth.people.body import Assets
from swardmap.synth.people.figure import figure_of
from swardmap.synth.people.gait import gait_of, step_meshes
from swardmap.synth.people.riding import Fit, astride, bicycles, fit_of, rider
from swardmap.synth.people.worn import Figure
from swardmap.synth.shapes import placed
from swardmap.synth.terrain import Terrain

PHASES = 16


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """A way: straight pieces between points; closed ones go round, open ones there and back.

    Attributes:
        xy: k x 2, metres in the frame map.
        closed: whether the last point is joined to the first.
    """

    xy: Float64Array
    closed: bool = False

    def __post_init__(self) -> None:
        if self.xy.ndim != 2 or self.xy.shape[1] != 2 or len(self.xy) < 2 or not np.isfinite(self.xy).all():
            raise InvalidValueError(
                f"path: expected at least 2 finite points of x, y; got shape {self.xy.shape}"
            )
        if not self.length_m > 0:
            raise InvalidValueError("path: expected points that differ, got a path of no length")

    @property
    def _ring(self) -> Float64Array:
        """The points of one whole round."""
        return np.vstack([self.xy, self.xy[:1] if self.closed else self.xy[-2::-1]])

    @property
    def length_m(self) -> float:
        """Of one round, or of the way there and back."""
        return float(np.linalg.norm(np.diff(self._ring, axis=0), axis=1).sum())

    def at(self, distance_m: float) -> Float64Array:
        """(2,): the point after a distance."""
        ring = self._ring
        ends = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
        d = distance_m % ends[-1]
        return np.array([np.interp(d, ends, ring[:, 0]), np.interp(d, ends, ring[:, 1])])

    def heading_rad(self, distance_m: float, half_m: float = 0.25) -> float:
        """Direction of travel about z, smoothed over 2 * `half_m` at the corners."""
        half = min(half_m, self.length_m / 8)
        for reach in (half, half / 10):  # an open way turns round on the spot
            ahead = self.at(distance_m + reach) - self.at(distance_m - reach)
            if np.linalg.norm(ahead) > 0.3 * reach:
                break
        else:
            ahead = self.at(distance_m + half) - self.at(distance_m)
        return float(np.arctan2(ahead[1], ahead[0]))


@dataclass(frozen=True, slots=True, eq=False)
class Walker:
    """Somebody who walks, runs or rides along a path, or the bicycle; it leans with the ground.

    Attributes:
        models: one for each phase of the cycle, equally far apart; `at` gives these very objects.
        path: where to; z comes from the ground.
        ground: walked on.
        speed_mps: along the path.
        stride_m: way of one cycle.
        start_m: on the path at time 0.
        pose: walking, running or riding.
        base_m: between the points that stand on the ground: the feet of a step, the wheels.
        kind: of the thing.
        label: of the thing.
    """

    models: tuple[Model, ...]
    path: Path
    ground: Terrain
    speed_mps: float
    stride_m: float
    start_m: float = 0.0
    pose: str = "walking"
    base_m: float = 0.5
    kind: str = "person"
    label: LabelClass = PERSON

    def at(self, stamp_ns: int) -> Thing:
        """The thing at a time."""
        distance = self.start_m + self.speed_mps * stamp_ns * 1e-9
        phase = int(np.floor(distance / self.stride_m * len(self.models) + 0.5)) % len(self.models)
        T = _on_ground(self.path, self.ground, distance, self.base_m)
        return Thing(self.models[phase], self.kind, T, self.label, self.pose)


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A ready model, such as a dog, that is moved along a path; it bobs a little.

    Attributes:
        model: x to the front, standing on z = 0.
        kind: of the thing.
        path: where to; z comes from the ground.
        ground: moved on.
        speed_mps: along the path.
        start_m: on the path at time 0.
        bob_m: height of the bobbing; it is never below the ground.
        pose: of the thing.
    """

    model: Model
    kind: str
    path: Path
    ground: Terrain
    speed_mps: float
    start_m: float = 0.0
    bob_m: float = 0.015
    pose: str = "walking"

    def at(self, stamp_ns: int) -> Thing:
        """The thing at a time."""
        distance = self.start_m + self.speed_mps * stamp_ns * 1e-9
        T = _on_ground(self.path, self.ground, distance)
        T[2, 3] += self.bob_m * 0.5 * (1 - np.cos(2 * np.pi * distance / 0.45))
        return Thing(self.model, self.kind, T, OTHER, self.pose)


def _on_ground(path: Path, ground: Terrain, distance_m: float, base_m: float = 0.0) -> Float64Array:
    """T_map_model on the ground, pitched so that points base_m apart, fore and aft, both touch it."""
    (x, y), yaw = path.at(distance_m), path.heading_rad(distance_m)
    fore = np.array([np.cos(yaw), np.sin(yaw)]) * base_m / 2
    ahead, behind = ground.height_at(np.add((x, y), [fore, -fore]))
    T = placed(float(x), float(y), float(ahead + behind) / 2, yaw)
    if base_m > 0:
        slope = float(ahead - behind) / base_m
        c, s = 1 / np.hypot(1, slope), slope / np.hypot(1, slope)
        T[:3, :3] = T[:3, :3] @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    return T


def walker(
    rng: np.random.Generator, assets: Assets, path: Path, ground: Terrain, speed_mps: float | None = None,
    running: bool = False, group: str | None = None,
) -> Walker:  # fmt: skip
    """Somebody by chance who goes along a path.

    Args:
        rng: everything by chance comes from it.
        assets: have the arrays `people`.
        path: where to.
        ground: walked on.
        speed_mps: None = by chance and by the length of the legs.
        running: children and adults run at 2 to 3 m/s.
        group: of GROUPS; None = by chance.
    """
    figure = figure_of(rng, assets, group)
    if speed_mps is None:
        tall = np.sqrt(figure.body.height_m / 1.7)
        speed_mps = float(rng.uniform(2.0, 3.0) if running else rng.uniform(0.8, 1.4)) * float(tall)
    gait = gait_of(figure, speed_mps, running)
    pose = "running" if running else "walking"
    name = f"person-{pose}-{int(rng.integers(2**62)):x}"
    models = tuple(Model(f"{name}-{k}", step_meshes(figure, gait, k / PHASES)) for k in range(PHASES))
    start = float(rng.uniform(0, path.length_m))
    return Walker(models, path, ground, speed_mps, gait.stride_m, start, pose, gait.stride_m / 3)


def cyclist(
    rng: np.random.Generator, assets: Assets, path: Path, ground: Terrain, speed_mps: float | None = None
) -> tuple[Walker, Walker]:
    """Somebody on a bicycle that goes along a path, and the bicycle.

    Args:
        rng: everything by chance comes from it.
        assets: have the arrays `people`.
        path: where to.
        ground: ridden on.
        speed_mps: None = by chance, slow as on a lawn.
    """
    figure, fit = _fitted(rng, assets)
    speed = float(rng.uniform(1.4, 2.4)) if speed_mps is None else speed_mps
    name, start = f"person-riding-{int(rng.integers(2**62)):x}", float(rng.uniform(0, path.length_m))
    people = tuple(Model(f"{name}-{k}", rider(figure, fit, k / PHASES)) for k in range(PHASES))
    way = (path, ground, speed, fit.stride_m, start, "riding", fit.wheelbase_m)
    return Walker(people, *way), Walker(bicycles(rng, fit, PHASES), *way, kind="bicycle", label=OTHER)


def beside_bicycle(rng: np.random.Generator, assets: Assets) -> tuple[Model, Model]:
    """Somebody who stands over a bicycle, and the bicycle, in one frame."""
    figure, fit = _fitted(rng, assets)
    model = Model(f"person-astride-{int(rng.integers(2**62)):x}", astride(figure, fit))
    return model, bicycles(rng, fit, 4)[int(rng.integers(4))]


def _fitted(rng: np.random.Generator, assets: Assets) -> tuple[Figure, Fit]:
    """Somebody dressed for a ride, and the size of the bicycle."""
    figure = figure_of(rng, assets, hatted="helmet" if rng.random() < 0.6 else None)
    return figure, fit_of(figure)
