"""Cut, smooth and thicken shells: the tailor's tools."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.synth.model import Float64Array
from swardmap.synth.people.body import Shell


def unique_rows(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Index of the first of each different row (n x k whole numbers), number of each row, how often each is.

    Like numpy.unique of the rows, several times faster: rows are packed into single numbers.
    """
    low = rows.min(axis=0)
    span = rows.max(axis=0) - low + 1
    if float(np.prod(span.astype(np.float64))) >= 2.0**63:
        raise InvalidValueError(f"unique rows: the columns span too much to be packed, {span.tolist()}")
    key = np.zeros(len(rows), np.int64)
    for column in range(rows.shape[1]):
        key = key * span[column] + (rows[:, column] - low[column])
    _, first, number, count = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
    return first.astype(np.int64), number.reshape(-1).astype(np.int64), count.astype(np.int64)


def summed(values: Float64Array, at: NDArray[np.int64], count: int) -> Float64Array:
    """Count x k: sums of the rows of `values` (n x k) that go to the same place."""
    return np.stack([np.bincount(at, column, count) for column in values.T], axis=1)


def welded(shell: Shell) -> NDArray[np.int64]:
    """For each vertex the number of its place: those that lie together share one."""
    return unique_rows(np.round(shell.mean * 1e4).astype(np.int64))[1]


def normals_of(xyz: Float64Array, faces: NDArray[np.int64], place: NDArray[np.int64]) -> Float64Array:
    """N x 3, of length 1: mean of the faces around each place, weighted by area."""
    n = np.cross(xyz[faces[:, 1]] - xyz[faces[:, 0]], xyz[faces[:, 2]] - xyz[faces[:, 0]])
    total = summed(np.repeat(n, 3, axis=0), place[faces].reshape(-1), int(place.max()) + 1)
    total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-15)
    out: Float64Array = total[place]
    return out


def clipped(shell: Shell, level: Callable[[Shell], Float64Array]) -> Shell:
    """What lies where `level` (n numbers, linear between vertices) is positive; cut edges are straight."""
    value = level(shell)
    value = np.where(np.abs(value) < 1e-6, 1e-6, value)
    inside = value[shell.faces] > 0
    count = inside.sum(1)
    whole = shell.faces[count == 3]
    data = np.hstack([shell.xyz, shell.weights, shell.along, shell.mean])
    cut = shell.faces[(count == 1) | (count == 2)]
    odd = np.where((value[cut] > 0).sum(1) == 1, (value[cut] > 0).argmax(1), (value[cut] < 0).argmax(1))
    cut = cut[np.arange(len(cut))[:, None], (odd[:, None] + np.arange(3)) % 3]
    lone = value[cut[:, 0]] > 0
    pairs = np.sort(np.concatenate([cut[:, [0, 1]], cut[:, [0, 2]]]), axis=1)
    first, number, _ = unique_rows(pairs)
    edges = pairs[first]
    a, b = value[edges[:, 0]], value[edges[:, 1]]
    t = (a / (a - b))[:, None]
    data = np.concatenate([data, data[edges[:, 0]] * (1 - t) + data[edges[:, 1]] * t])
    p, q = np.split(number + len(value), 2)
    one = np.stack((cut[:, 0], p, q), axis=1)[lone]
    two = np.concatenate([np.stack((p, cut[:, 1], cut[:, 2]), 1), np.stack((p, cut[:, 2], q), 1)])
    faces = np.concatenate([whole, one, two[np.tile(~lone, 2)]])
    used, small = np.unique(faces, return_inverse=True)
    data, bones = data[used], shell.weights.shape[1]
    return Shell(
        data[:, :3], data[:, 3 : 3 + bones], data[:, 3 + bones : 7 + bones], data[:, 7 + bones :],
        small.reshape(-1, 3).astype(np.int64),
    )  # fmt: skip


def border(shell: Shell) -> NDArray[np.int64]:
    """K x 2: edges with one face, in that face's order."""
    f = shell.faces
    edges = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    first, _, count = unique_rows(np.sort(edges, axis=1))
    out: NDArray[np.int64] = edges[first[count == 1]]
    return out


def smoothed(values: Float64Array, shell: Shell, rounds: int) -> Float64Array:
    """Mean with the neighbours, again and again; the border moves only along itself."""
    f = shell.faces
    pairs = np.concatenate(
        [f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]], f[:, [1, 0]], f[:, [2, 1]], f[:, [0, 2]]]
    )
    edges = border(shell)
    rim = np.zeros(len(values), bool)
    rim[edges.ravel()] = True
    pairs = np.concatenate([pairs[~rim[pairs[:, 0]]], edges, edges[:, ::-1]])
    count = np.maximum(np.bincount(pairs[:, 0], minlength=len(values)), 1)[:, None]
    for _ in range(rounds):
        values = 0.5 * values + 0.5 * summed(values[pairs[:, 1]], pairs[:, 0], len(values)) / count
    return values


def hemmed(shell: Shell, depth_m: float) -> Shell:
    """The same with its borders turned in by `depth_m`, so that cloth has a thickness."""
    edges = border(shell)
    if not len(edges):
        return shell
    rim, local = np.unique(edges, return_inverse=True)
    local = local.reshape(-1, 2) + len(shell.xyz)
    n = normals_of(shell.xyz, shell.faces, np.arange(len(shell.xyz)))[rim]
    lip = (
        np.stack((edges[:, 1], edges[:, 0], local[:, 0]), 1),
        np.stack((edges[:, 1], local[:, 0], local[:, 1]), 1),
    )

    def twice(values: Float64Array) -> Float64Array:
        return np.concatenate([values, values[rim]])

    return Shell(
        np.concatenate([shell.xyz, shell.xyz[rim] - n * depth_m]), twice(shell.weights), twice(shell.along),
        np.concatenate([shell.mean, shell.mean[rim] - n * depth_m]), np.concatenate([shell.faces, *lip]),
    )  # fmt: skip


def lined(shell: Shell, gap_m: float) -> Shell:
    """A shell with its own inside, for what can be looked into: skirts."""
    n = normals_of(shell.xyz, shell.faces, np.arange(len(shell.xyz)))
    size = len(shell.xyz)
    inner = shell.faces[:, ::-1] + size
    return Shell(
        np.concatenate([shell.xyz, shell.xyz - n * gap_m]), np.tile(shell.weights, (2, 1)),
        np.tile(shell.along, (2, 1)), np.concatenate([shell.mean, shell.mean - n * gap_m]),
        np.concatenate([shell.faces, inner]),
    )  # fmt: skip


def finer(shell: Shell) -> Shell:
    """Each triangle as four; the new points lie half-way."""
    f = shell.faces
    pairs = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1)
    first, number, _ = unique_rows(pairs)
    edges = pairs[first]
    ab, bc, ca = np.split(number + len(shell.xyz), 3)
    a, b, c = f.T
    faces = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])

    def halves(values: Float64Array) -> Float64Array:
        return np.concatenate([values, (values[edges[:, 0]] + values[edges[:, 1]]) / 2])

    return replace(
        shell, xyz=halves(shell.xyz), weights=halves(shell.weights), along=halves(shell.along),
        mean=halves(shell.mean), faces=faces,
    )  # fmt: skip
