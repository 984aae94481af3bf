"""Ways of a mower over a lawn: lanes to and fro with turns, and free curves."""

import numpy as np

from swardmap.synth.model import Float64Array
from swardmap.synth.scene.clearance import Clearance

STEP_M = 0.02
THINGS_M, BORDER_M = 0.5, 0.12  # the mower's middle keeps this far from things and from the lawn's border
TURN_RATE = 0.9  # of a mower, rad/s on the spot; for the time that a way takes


def to_and_fro(clear: Clearance, corners_m: Float64Array, rng: np.random.Generator) -> Float64Array:
    """Lanes side by side, with half circles or turns on the spot between them.

    Args:
        clear: where there is room.
        corners_m: of the lot.
        rng: direction, distance and start of the lanes.

    Returns:
        n x 3: x, y and heading (rad, without jumps); a step moves up to STEP_M or turns a few degrees.
        Empty where there is no lane.
    """
    turn, width = rng.uniform(0, np.pi), rng.uniform(0.35, 0.9)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    uv = corners_m @ R
    (u0, v0), (u1, v1) = uv.min(axis=0), uv.max(axis=0)
    across = np.arange(v0 + width / 2, v1, width)
    along = np.arange(u0, u1, STEP_M * 2)
    chain: list[Float64Array] = []
    chains: list[list[Float64Array]] = []
    forward = bool(rng.random() < 0.5)
    for v in across:
        lane = _lane(clear, R, along, v, chain[-1][-1] if chain else None)
        if lane is None:
            chains, chain = [*chains, chain], []
            continue
        start, end = (lane[0], lane[1]) if forward else (lane[1], lane[0])
        straight = np.array([(start, v), (end, v)])
        if chain and not _joined(clear, R, chain, straight, width):
            chains, chain = [*chains, chain], []
        chain.append(straight)
        forward = not forward
    longest = max([*chains, chain], key=len)
    return _smooth([line @ R.T for line in longest]) if longest else np.zeros((0, 3))


def _lane(
    clear: Clearance, R: Float64Array, along: Float64Array, v: float, before: Float64Array | None
) -> tuple[float, float] | None:
    """The free part of a line that is nearest to where the last one ended, or the longest; 1.2 m or more."""
    free = clear.free(np.stack((along, np.full(along.shape, v)), axis=1) @ R.T, THINGS_M, BORDER_M)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(np.int8)))
    parts = [(along[a], along[b - 1]) for a, b in edges.reshape(-1, 2) if along[b - 1] - along[a] > 1.2]
    if not parts:
        return None
    if before is None:
        return max(parts, key=lambda part: part[1] - part[0])
    near = [min(abs(part[0] - before[0]), abs(part[1] - before[0])) for part in parts]
    return parts[int(np.argmin(near))]


def _joined(
    clear: Clearance, R: Float64Array, chain: list[Float64Array], lane: Float64Array, width: float
) -> bool:
    """Shorten the last lane and the new one in place to where a half circle fits, and add it to the chain."""
    last = chain[-1]
    sign = np.sign(last[1, 0] - last[0, 0])
    reach = min(sign * last[1, 0], sign * lane[0, 0]) - width / 2
    if reach < sign * last[0, 0] + 0.3 or reach < sign * lane[1, 0] + 0.3:
        return False
    angle = np.linspace(-np.pi / 2, np.pi / 2, 24)
    middle = (last[1, 1] + lane[0, 1]) / 2
    arc = np.stack((sign * (reach + width / 2 * np.cos(angle)), middle + width / 2 * np.sin(angle)), axis=1)
    arc[[0, -1], 0] = sign * reach
    if not clear.free(arc @ R.T, THINGS_M, BORDER_M).all():
        return False
    last[1, 0] = lane[0, 0] = sign * reach
    chain.append(arc)
    return True


def wander(clear: Clearance, start: Float64Array, length_m: float, rng: np.random.Generator) -> Float64Array:
    """A free curve that bends away from things and the border, and turns on the spot where it must.

    Args:
        clear: where there is room.
        start: (3,): x, y, heading; x, y must be free.
        length_m: of the way.
        rng: how it bends.

    Returns:
        n x 3, as `to_and_fro`.
    """
    x, y, yaw = (float(v) for v in start)
    bend, spin, way = 0.0, 0.0, [(x, y, yaw)]
    for _ in range(int(length_m / STEP_M) * 2):
        bend = float(np.clip(0.985 * bend + rng.normal(0, 0.06), -1.2, 1.2))
        look = np.array(
            [(x + d * np.cos(yaw + a), y + d * np.sin(yaw + a)) for d in (0.5, 1.0) for a in (0, 0.5, -0.5)]
        )
        ahead, left, right = clear.room(look).reshape(2, 3).min(axis=0)
        turn = bend
        if ahead < 0.75:
            turn += (1.6 if left >= right else -1.6) * (0.75 - ahead) / 0.5
        nx, ny = x + STEP_M * np.cos(yaw), y + STEP_M * np.sin(yaw)
        if clear.free(np.array([(nx, ny)]), THINGS_M, BORDER_M)[0]:
            x, y, yaw, spin = nx, ny, yaw + turn * STEP_M, 0.0
        else:
            spin = spin or (0.03 if left >= right else -0.03)  # the same way round until it is free
            yaw += spin
        way.append((x, y, yaw))
    return np.array(way)


def _smooth(lines: list[Float64Array]) -> Float64Array:
    """Lines joined end to end as points every step, with a heading that turns on the spot at corners."""
    xy = np.concatenate(lines)
    keep = np.concatenate([[True], np.linalg.norm(np.diff(xy, axis=0), axis=1) > 1e-6])
    xy = xy[keep]
    step = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    s = np.arange(0, along[-1], STEP_M)
    dense = np.stack([np.interp(s, along, xy[:, k]) for k in (0, 1)], axis=1)
    heading = np.unwrap(np.arctan2(*np.diff(xy, axis=0).T[::-1]))
    yaw = np.interp(s, (along[:-1] + along[1:]) / 2, heading)
    return np.column_stack([dense, _eased(yaw)])


def _eased(yaw: Float64Array) -> Float64Array:
    """The heading, averaged over 20 cm, so that it does not jump in its rate."""
    n = max(1, int(0.2 / STEP_M))
    padded = np.concatenate([np.full(n, yaw[0]), yaw, np.full(n, yaw[-1])])
    return np.convolve(padded, np.full(2 * n + 1, 1 / (2 * n + 1)), mode="valid")


def timed(way: Float64Array, speed_mps: float) -> Float64Array:
    """Seconds at which each point of a way is reached, from 0."""
    move = np.linalg.norm(np.diff(way[:, :2], axis=0), axis=1) / speed_mps
    turn = np.abs(np.diff(way[:, 2])) / TURN_RATE
    return np.concatenate([[0.0], np.cumsum(np.maximum(move, turn))])


def there_and_back(way: Float64Array) -> Float64Array:
    """A way, a turn on the spot, and the same way back."""
    spin = np.linspace(0, np.pi, 90)[1:, None]
    last = way[-1]
    turn = np.concatenate([np.broadcast_to(last[:2], (len(spin), 2)), last[2] + spin], axis=1)
    back = np.column_stack([way[::-1, :2], way[::-1, 2] + turn[-1, 2] - last[2]])
    return np.concatenate([way, turn, back[1:]])
