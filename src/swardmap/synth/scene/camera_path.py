"""The way of a camera on a mower over a garden, as poses in time."""

from dataclasses import dataclass

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.labels import PERSON
from swardmap.synth.model import MAP_FRAME, Float64Array, Garden
from swardmap.synth.scene.areas import inside_convex_m
from swardmap.synth.scene.clearance import Clearance, clearance_of
from swardmap.synth.scene.lanes import BORDER_M, THINGS_M, there_and_back, timed, to_and_fro, wander
from swardmap.synth.terrain import Terrain

WHEELS_M = (0.25, 0.2)  # half the wheelbase, half the gauge
ACTORS_M = 0.7  # the camera keeps this far from the middle of whoever moves
SEEN_M = (0.6, 15.0)
SEEN_RAD = 0.45
WISH_M = (1.5, 9.0)  # of each garden, one distance at which people are wished for
TRIES, GOOD = 15, 0.75
AHEAD_M, INWARD_SHARE = 4.0, 0.25  # what a look into the lot counts beside people
FAR_M = 8.0  # at least, of the ground that is seen
PEOPLE_SHARE = 0.9  # of the runs look for a way on which people are seen

People = tuple[Float64Array, list[Float64Array]]
"""Where those stand who keep their place (n x 2), and where each who moves is, frame by frame (n x 2)."""


@dataclass(frozen=True, slots=True)
class MowerCamera:
    """A camera on a mower.

    Attributes:
        intrinsics: of the camera.
        height_m: of the camera above the ground on level land.
        pitch_deg: how far it looks down.
        roll_deg: right side down positive.
        forward_m, left_m: place on the mower, from its middle.
        vibration_m, vibration_deg: amplitude of its shaking.
    """

    intrinsics: Intrinsics
    height_m: float = 0.8
    pitch_deg: float = 18.0
    roll_deg: float = 0.0
    forward_m: float = 0.2
    left_m: float = 0.0
    vibration_m: float = 0.002
    vibration_deg: float = 0.15

    def __post_init__(self) -> None:
        if not 0 < self.height_m <= 3 or not -90 <= self.pitch_deg <= 90:
            raise InvalidValueError(
                f"rig: expected a height in 0-3 m and a pitch in -90..90 degrees, "
                f"got {self.height_m} m and {self.pitch_deg}"
            )
        if min(self.vibration_m, self.vibration_deg) < 0:
            raise InvalidValueError(f"rig: expected vibrations of 0 or more, got {self}")


def random_rig(seed: int, width: int = 640, height: int = 480) -> MowerCamera:
    """A rig within what mowers have: 0.3-1.3 m high, 10-30 degrees down, a lens near that of a D435i.

    The lower the camera, the less it looks down: the middle of the upper edge sees the ground to 8 m or more.
    """
    rng = np.random.default_rng([seed, 41])
    fx = width * rng.uniform(0.84, 0.98)
    cx, cy = width / 2 - 0.5 + rng.normal(0, 0.008) * width, height / 2 - 0.5 + rng.normal(0, 0.008) * height
    lens = Intrinsics(width, height, float(fx), float(fx * rng.uniform(0.995, 1.005)), float(cx), float(cy))
    height_m = float(rng.uniform(0.3, 1.3))
    upper = np.degrees(np.arctan2(lens.cy + 0.5, lens.fy))
    steepest = min(30.0, float(upper + np.degrees(np.arctan(height_m / FAR_M))))
    return MowerCamera(
        lens, height_m, float(10 + (steepest - 10) * rng.random() ** 1.6),
        float(np.clip(rng.normal(0, 1.3), -4, 4)),
        float(rng.uniform(-0.1, 0.35)), float(rng.uniform(-0.08, 0.08)),
        float(rng.uniform(0, 0.004)), float(rng.uniform(0, 0.35)),
    )  # fmt: skip


def mowing_run(
    garden: Garden, seed: int, frames: int, rate_hz: float = 10.0, rig: MowerCamera | None = None
) -> tuple[tuple[int, Pose], ...]:
    """Poses of the camera on a way over the lawn; the mower tilts with the ground.

    Ways are lanes to and fro or free curves, at 0.3-0.7 m/s. Of several, mostly one on which people are seen.

    Args:
        garden: where.
        seed: of the way; the rig has its own.
        frames: how many poses.
        rate_hz: how many a second.
        rig: the camera; None = random_rig(seed).

    Returns:
        (stamp_ns, T_map_camera) of each frame, from 0 ns on.

    Raises:
        InvalidValueError: for less than one frame, a rate that is not positive, or a lawn without room.
    """
    if frames < 1 or not (np.isfinite(rate_hz) and rate_hz > 0):
        raise InvalidValueError(f"run: expected frames and a positive rate, got {frames} and {rate_hz} Hz")
    rig = rig or random_rig(seed)
    rng = np.random.default_rng([seed, 42])
    stamps = [round(i * 1e9 / rate_hz) for i in range(frames)]
    track = _track(garden, clearance_of(garden), np.array(stamps) * 1e-9, stamps, rng)
    shake = _shaking(np.array(stamps) * 1e-9, rng)
    return tuple(
        (stamp, _camera_pose(garden.ground, rig, x, y, yaw, wobble))
        for stamp, (x, y, yaw), wobble in zip(stamps, track, shake, strict=True)
    )


def _track(
    garden: Garden, clear: Clearance, seconds: Float64Array, stamps: list[int], rng: np.random.Generator
) -> Float64Array:
    """The best of some ways, sampled at the times: n x 3 of x, y, heading."""
    people, others = _positions(garden, stamps)
    speed, wants = float(rng.uniform(0.3, 0.7)), rng.random() < PEOPLE_SHARE
    wish_m = float(np.exp(rng.uniform(*np.log(WISH_M))))
    need_m = float(min(seconds[-1] * speed + 2, 400))
    found: list[tuple[float, Float64Array]] = []
    for k in range(TRIES):
        way = (
            to_and_fro(clear, garden.lot_m, rng) if k % 3 == 2 else _curve(clear, garden, people, need_m, rng)
        )
        if len(way) < 50:
            continue
        for track in _windows(way, speed, seconds, rng):
            if _moves(track, speed, seconds) and _apart(track, [*people[1], *others], ACTORS_M):
                score = INWARD_SHARE * _looks_inward(garden, track)
                score += _seen(clear, track, people, wish_m) if wants else 0.0
                found.append((score, track))
        if found and (not wants or max(score for score, _ in found) > GOOD):
            break
    if not found:
        raise InvalidValueError(
            f"{garden.name}: found no way with {THINGS_M} m to things and {BORDER_M} m to the border of the "
            "lawn; take another seed"
        )
    return max(found, key=lambda pair: pair[0])[1]


def _curve(
    clear: Clearance, garden: Garden, people: People, need_m: float, rng: np.random.Generator
) -> Float64Array:
    """A free curve that begins some metres from somebody, towards them; anywhere if there is nobody."""
    low, high = garden.lot_m.min(axis=0), garden.lot_m.max(axis=0)
    heading = rng.uniform(-np.pi, np.pi, 300)
    tries = rng.uniform(low, high, (300, 2))
    places = [*people[0], *(line[0] for line in people[1])]
    if places:
        away = rng.uniform(2.0, 9.0, 300)
        towards = np.stack((np.cos(heading), np.sin(heading)), axis=1)
        tries = np.array(places[int(rng.integers(len(places)))]) - away[:, None] * towards
    free = np.flatnonzero(clear.free(tries, THINGS_M + 0.1, BORDER_M + 0.1))
    if not len(free):
        return np.zeros((0, 3))
    start = np.array([*tries[free[0]], heading[free[0]] + rng.normal(0, 0.25)])
    return wander(clear, start, min(need_m, 60.0), rng)


def _windows(
    way: Float64Array, speed: float, seconds: Float64Array, rng: np.random.Generator
) -> list[Float64Array]:
    """Some parts of a way that last as long as the run; the way is taken back and forth if it is short."""
    while timed(way, speed)[-1] < seconds[-1]:
        way = there_and_back(way)
    time = timed(way, speed)
    starts = np.append(rng.uniform(0, time[-1] - seconds[-1], 3), 0.0)
    return [np.stack([np.interp(t + seconds, time, way[:, k]) for k in range(3)], axis=1) for t in starts]


def _positions(garden: Garden, stamps: list[int]) -> tuple[People, list[Float64Array]]:
    """Where people stand (n x 2), where those who move are at each stamp, and where other actors are."""
    still = [thing.T_map_model[:2, 3] for thing in garden.things if thing.label == PERSON]
    moving: list[Float64Array] = []
    others: list[Float64Array] = []
    for actor in garden.actors:
        things = [actor.at(stamp) for stamp in stamps]
        line = np.array([thing.T_map_model[:2, 3] for thing in things])
        (moving if things[0].label == PERSON else others).append(line)
    return (np.array(still).reshape(-1, 2), moving), others


def _moves(track: Float64Array, speed: float, seconds: Float64Array) -> bool:
    """Whether the mower drives at least half of the time, and does not mostly turn on the spot."""
    driven = np.linalg.norm(np.diff(track[:, :2], axis=0), axis=1).sum()
    return bool(driven >= 0.5 * speed * seconds[-1])


def _apart(track: Float64Array, lines: list[Float64Array], room_m: float) -> bool:
    return all(bool((np.linalg.norm(track[:, :2] - line, axis=1) > room_m).all()) for line in lines)


def _seen(clear: Clearance, track: Float64Array, people: People, wish_m: float) -> float:
    """Mean over time of how well somebody is in view, 0..1: about as far as wished, nothing tall between."""
    still, moving = people
    away = [np.broadcast_to(at, (len(track), 2)) for at in still] + moving
    seen = np.zeros(len(track))
    for place in away:
        d = place - track[:, :2]
        r = np.linalg.norm(d, axis=1)
        off = np.angle(np.exp(1j * (np.arctan2(d[:, 1], d[:, 0]) - track[:, 2])))
        within = (r > SEEN_M[0]) & (r < SEEN_M[1]) & (np.abs(off) < SEEN_RAD)
        within[within] = clear.sees(track[within, :2], place[within])
        fits = 0.3 + 0.7 * np.exp(-np.square(np.log(np.maximum(r, 0.1) / wish_m) / 0.6))
        seen = np.maximum(seen, within * fits)
    return float(seen.mean())


def _looks_inward(garden: Garden, track: Float64Array) -> float:
    """Share of the times at which the lot reaches some metres ahead."""
    ahead = track[:, :2] + AHEAD_M * np.stack((np.cos(track[:, 2]), np.sin(track[:, 2])), axis=1)
    x, y = ahead.astype(np.float32).T
    return float((inside_convex_m(garden.lot_m, x, y) > 0).mean())


def _camera_pose(
    ground: Terrain, rig: MowerCamera, x: float, y: float, yaw: float, shake: Float64Array
) -> Pose:
    """T_map_camera of a mower whose wheels stand on the ground at x, y."""
    base = Pose(MAP_FRAME, "base", on_wheels(ground, x, y, yaw))
    dz, roll, pitch = shake * [rig.vibration_m, rig.vibration_deg, rig.vibration_deg]
    mount = mount_pose(
        rig.height_m + dz, rig.pitch_deg + pitch, rig.roll_deg + roll, xy_m=(rig.forward_m, rig.left_m)
    )
    return base @ mount


def on_wheels(ground: Terrain, x: float, y: float, yaw: float) -> Float64Array:
    """T_map_base: on the plane that fits the ground under the four wheels best, heading along yaw."""
    a, b = WHEELS_M
    wheels = np.array([(a, b), (a, -b), (-a, b), (-a, -b)])
    c, s = np.cos(yaw), np.sin(yaw)
    z = ground.height_at(wheels @ np.array([[c, s], [-s, c]]) + (x, y))
    front = np.array([2 * a, 0, (z[0] + z[1] - z[2] - z[3]) / 2])
    left = np.array([0, 2 * b, (z[0] + z[2] - z[1] - z[3]) / 2])
    forward = front / np.linalg.norm(front)
    up = np.cross(front, left)
    up /= np.linalg.norm(up)
    T = np.eye(4)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    T[:3, :3] = turn @ np.stack((forward, np.cross(up, forward), up), axis=1)
    T[:3, 3] = x, y, z.mean()
    return T


def _shaking(seconds: Float64Array, rng: np.random.Generator) -> Float64Array:
    """Smooth shaking, n x 3 of -1..1: in height, roll and pitch, of some waves of 0.8-6 Hz each."""
    hz, phase = rng.uniform(0.8, 6.0, (3, 4)), rng.uniform(0, 2 * np.pi, (3, 4))
    waves = np.sin(2 * np.pi * hz * seconds[:, None, None] + phase)
    shaking: Float64Array = waves.mean(axis=2)
    return shaking
