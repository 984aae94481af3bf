"""Exact squared distances up to a radius, in two separable passes (twin: costmap.squared_distances)."""

import numpy as np

from swardmap.kernels.compiled import compiled


@compiled()
def squared_distances(occupied, radius, out):  # type: ignore[no-untyped-def]
    """Squared distance in cells to the nearest occupied cell, at most (radius + 1) squared.

    Args:
        occupied: (H, W) bool.
        radius: in cells; farther cells all get (radius + 1) squared.
        out: (H, W) int32, written here.
    """
    H, W = occupied.shape
    far = np.int32(radius + 1)
    vertical = np.empty((H, W), np.int32)
    for x in range(W):
        vertical[0, x] = 0 if occupied[0, x] else far
    for y in range(1, H):
        for x in range(W):
            up = min(far, vertical[y - 1, x] + np.int32(1))
            vertical[y, x] = np.int32(0) if occupied[y, x] else up
    for y in range(H - 2, -1, -1):
        for x in range(W):
            vertical[y, x] = min(vertical[y, x], vertical[y + 1, x] + np.int32(1))
    limit = np.int32(far * far)
    squares = np.empty(W + 2 * radius, np.int32)
    squares[:] = limit
    for y in range(H):
        _nearest_in_row(vertical[y], squares, radius, limit, out[y])


@compiled()
def _nearest_in_row(vertical, squares, radius, limit, out):  # type: ignore[no-untyped-def]
    """Min over |dx| <= radius of vertical^2 + dx^2; rows without anything near are skipped."""
    W = out.shape[0]
    nearest = limit
    for x in range(W):
        square = vertical[x] * vertical[x]
        squares[x + radius] = square
        nearest = min(nearest, square)
    for x in range(W):
        out[x] = min(limit, squares[x + radius])
    if nearest >= limit:
        return
    for dx in range(1, radius + 1):
        step = np.int32(dx * dx)
        left, right = radius - dx, radius + dx
        for x in range(W):
            out[x] = min(out[x], min(squares[x + left], squares[x + right]) + step)


@compiled()
def apply_costs(squared, cost_of_squared, inflate_unknown, costs):  # type: ignore[no-untyped-def]
    """Raise `costs` to the table's value; unknown cells give way as Nav2's inflation layer has it."""
    last = cost_of_squared.shape[0] - 1
    for y in range(costs.shape[0]):
        for x in range(costs.shape[1]):
            new = cost_of_squared[min(squared[y, x], last)]
            old = costs[y, x]
            if old == 255:
                if new >= 253 or (inflate_unknown and new > 0):
                    costs[y, x] = new
            elif new > old:
                costs[y, x] = new
