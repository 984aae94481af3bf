"""A row of the depth image at a time: metres, and what the 3x3 filter keeps (twin: perception.cloud).

Branch-free loops that vectorise. Each row function stays a function of its own: inlined into one body, the
compiler would have to prove that too many arrays do not overlap, and would give up on vectors.
"""

import numpy as np

from swardmap.kernels.compiled import compiled
from swardmap.kernels.constants import FAR_AWAY


@compiled(inline="never")
def depth_row(depth, unit_m, near_m, far_m, row):  # type: ignore[no-untyped-def]
    """One row in metres between two border pixels, FAR_AWAY where there is no reading in range.

    Returns:
        Pixels with any reading, and with one in range: without those a row needs no further work.
    """
    readings, in_range = np.int32(0), np.int32(0)
    for u in range(depth.shape[0]):
        z = np.float32(depth[u]) * unit_m
        readings = np.int32(readings + ((z > np.float32(0)) & (z < np.float32(np.inf))))
        near = (z >= near_m) & (z <= far_m) & (z > np.float32(0))
        in_range = np.int32(in_range + near)
        row[u + 1] = z if near else FAR_AWAY
    return readings, in_range


@compiled(inline="never")
def _plain_row(metres, row):  # type: ignore[no-untyped-def]
    """One row between two border pixels, FAR_AWAY where there is no reading."""
    for u in range(metres.shape[0]):
        row[u + 1] = metres[u] if metres[u] > np.float32(0) else FAR_AWAY


@compiled(inline="never")
def agreeing_row(above, here, below, relative, absolute_m, needed, keep):  # type: ignore[no-untyped-def]
    """keep[u] = 1 if enough of the 8 neighbours have about the same depth (cloud.consistent_depth)."""
    for u in range(keep.shape[0]):
        z = here[u + 1]
        t = z * relative + absolute_m
        n = np.int32(
            (abs(z - above[u]) <= t)
            + (abs(z - above[u + 1]) <= t)
            + (abs(z - above[u + 2]) <= t)
            + (abs(z - here[u]) <= t)
            + (abs(z - here[u + 2]) <= t)
            + (abs(z - below[u]) <= t)
            + (abs(z - below[u + 1]) <= t)
            + (abs(z - below[u + 2]) <= t)
        )
        keep[u] = np.uint8(n >= needed)


@compiled()
def consistent(metres, relative, absolute_m, needed, keep):  # type: ignore[no-untyped-def]
    """Which readings enough of their neighbours agree with (cloud.consistent_depth).

    Args:
        metres: (H, W) float32, NaN = no reading.
        relative: float32 share of the depth.
        absolute_m: float32 metres on top.
        needed: neighbours that must agree, at least 1.
        keep: (H, W) bool, written here.
    """
    H, W = metres.shape
    rows = np.full((3, W + 2), FAR_AWAY, np.float32)
    agree, needed = np.empty(W, np.uint8), np.int32(needed)
    _plain_row(metres[0], rows[0])
    for v in range(H):
        above, here, below = rows[(v + 2) % 3], rows[v % 3], rows[(v + 1) % 3]
        if v + 1 < H:
            _plain_row(metres[v + 1], below)
        else:
            below[:] = FAR_AWAY
        agreeing_row(above, here, below, relative, absolute_m, needed, agree)
        for u in range(W):
            keep[v, u] = (agree[u] > np.uint8(0)) & (here[u + 1] > np.float32(0))
