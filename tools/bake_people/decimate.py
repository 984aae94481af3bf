"""Fewer triangles without moving a vertex: half-edge collapses by quadric error.

Vertices are only dropped, so that every array of the full mesh (other bodies, weights, coordinates)
is taken to the small one by the index of those that stay. After Garland and Heckbert 1997.
"""

import heapq

import numpy as np
from numpy.typing import NDArray


def quadrics(
    xyz: NDArray[np.float64], faces: NDArray[np.int64], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """N x 4 x 4: squared distances to the planes of a vertex's faces, weighted by area and `weight`."""
    a, b, c = (xyz[faces[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    area = np.linalg.norm(n, axis=1)
    n /= np.maximum(area, 1e-15)[:, None]
    plane = np.concatenate([n, -(n * a).sum(1, keepdims=True)], axis=1)
    q_face = plane[:, :, None] * plane[:, None, :] * (area * weight[faces].mean(1))[:, None, None]
    q = np.zeros((len(xyz), 4, 4))
    for k in range(3):
        np.add.at(q, faces[:, k], q_face)
    return q


def decimated(
    xyz: NDArray[np.float64], faces: NDArray[np.int64], weight: NDArray[np.float64], target: int
) -> NDArray[np.int64]:
    """Faces (m x 3, of the same vertices) of a mesh with about `target` triangles; borders stay as they are.

    Args:
        xyz: n x 3.
        faces: m x 3.
        weight: n, how much an error at a vertex counts.
        target: number of faces.
    """
    q = quadrics(xyz, faces, weight)
    live: dict[int, tuple[int, ...]] = {k: tuple(int(v) for v in f) for k, f in enumerate(faces)}
    around: list[set[int]] = [set() for _ in range(len(xyz))]
    for k, f in live.items():
        for v in f:
            around[v].add(k)
    edges, count = np.unique(
        np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1),
        axis=0,
        return_counts=True,
    )
    border = np.zeros(len(xyz), bool)
    border[edges[count != 2].ravel()] = True
    stamp = [0] * len(xyz)
    heap: list[tuple[float, int, int, int, int]] = []

    def push(u: int, v: int) -> None:
        if not border[u]:
            p = np.append(xyz[v], 1.0)
            length = float(((xyz[u] - xyz[v]) ** 2).sum())
            cost = float(p @ (q[u] + q[v]) @ p) + 1e-6 * length * float(weight[u])
            heapq.heappush(heap, (cost, u, v, stamp[u], stamp[v]))

    for u, v in edges.tolist():
        push(u, v)
        push(v, u)
    while heap and len(live) > target:
        _, u, v, su, sv = heapq.heappop(heap)
        if stamp[u] != su or stamp[v] != sv or not around[u] or not around[v]:
            continue
        if not _may_collapse(xyz, live, around, u, v):
            continue
        _collapse(live, around, u, v)
        q[v] += q[u]
        stamp[v] += 1
        for w in {w for k in around[v] for w in live[k]} - {v}:
            push(w, v)
            push(v, w)
    return np.array(list(live.values()), np.int64)


def _collapse(live: dict[int, tuple[int, ...]], around: list[set[int]], u: int, v: int) -> None:
    """Give the faces around u to v; those that had both are gone."""
    for k in list(around[u]):
        f = live[k]
        for w in f:
            around[w].discard(k)
        if v in f:
            del live[k]
            continue
        live[k] = tuple(v if w == u else w for w in f)
        for w in live[k]:
            around[w].add(k)


def _may_collapse(
    xyz: NDArray[np.float64], live: dict[int, tuple[int, ...]], around: list[set[int]], u: int, v: int
) -> bool:
    """Whether u may go to v: the surface stays a surface, no face turns over or becomes a needle."""
    near_u = {w for k in around[u] for w in live[k]} - {u}
    near_v = {w for k in around[v] for w in live[k]} - {v}
    if len(near_u & near_v) != 2:
        return False
    for k in around[u]:
        f = live[k]
        if v in f:
            continue
        old = xyz[list(f)]
        new = xyz[[v if w == u else w for w in f]]
        n0 = np.cross(old[1] - old[0], old[2] - old[0])
        n1 = np.cross(new[1] - new[0], new[2] - new[0])
        l0, l1 = np.linalg.norm(n0), np.linalg.norm(n1)
        longest = max(((new[i] - new[i - 1]) ** 2).sum() for i in range(3))
        if l1 < 0.06 * longest or n0 @ n1 < 0.3 * l0 * l1:
            return False
    return True
