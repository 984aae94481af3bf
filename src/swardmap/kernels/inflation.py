"""Exact squared distances up to a radius, in two separable passes (twin: costmap.squared_distances).

A row at a time, in functions of their own, so that loops vectorise (kernels.depth says why).
"""

import numpy as np

from swardmap.kernels.compiled import compiled


@compiled(inline="never")
def _from_above(occupied, above, far, here):  # type: ignore[no-untyped-def]
    """Cells down from the nearest occupied one, of a row below another."""
    for x in range(here.shape[0]):
        one_more = np.int32(above[x] + np.int32(1))
        near = one_more if one_more < far else far
        here[x] = np.int32(0) if occupied[x] else near


@compiled(inline="never")
def _or_from_below(below, here):  # type: ignore[no-untyped-def]
    """The same, or up from one below if that is nearer."""
    for x in range(here.shape[0]):
        one_more = np.int32(below[x] + np.int32(1))
        here[x] = one_more if one_more < here[x] else here[x]


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
    vertical, nothing = np.empty((H, W), np.int32), np.full(W, far, np.int32)
    for y in range(H):
        _from_above(occupied[y], vertical[y - 1] if y > 0 else nothing, far, vertical[y])
    for y in range(H - 2, -1, -1):
        _or_from_below(vertical[y + 1], vertical[y])
    limit = np.int32(far * far)
    squares = np.full(W + 2 * radius, limit, np.int32)
    for y in range(H):
        out[y] = limit
        first, last = _ends(vertical[y], far)
        if first <= last:
            a, b = max(0, first - radius), min(W, last + 1 + radius)
            _square(vertical[y], squares[radius : radius + W])
            _nearest_in_row(squares[a : b + 2 * radius], radius, out[y, a:b])


@compiled()
def _ends(vertical, far):  # type: ignore[no-untyped-def]
    """First and last cell of a row that is near anything."""
    first, last = 0, vertical.shape[0] - 1
    while first <= last and vertical[first] >= far:
        first += 1
    while last > first and vertical[last] >= far:
        last -= 1
    return first, last


@compiled(inline="never")
def _square(vertical, squares):  # type: ignore[no-untyped-def]
    for x in range(vertical.shape[0]):
        squares[x] = np.int32(vertical[x] * vertical[x])


@compiled(inline="never")
def _beside(left, right, step, out):  # type: ignore[no-untyped-def]
    for x in range(out.shape[0]):
        near = left[x] if left[x] < right[x] else right[x]
        near = np.int32(near + step)
        out[x] = near if near < out[x] else out[x]


@compiled()
def _nearest_in_row(squares, radius, out):  # type: ignore[no-untyped-def]
    """Min over |dx| <= radius of vertical^2 + dx^2; `squares` reaches a radius further on both sides."""
    _beside(squares[radius:], squares[radius:], np.int32(0), out)
    for dx in range(1, radius + 1):
        _beside(squares[radius - dx :], squares[radius + dx :], np.int32(dx * dx), out)


@compiled(inline="never")
def _raise_row(squared, cost_of_squared, last, inflate_unknown, costs):  # type: ignore[no-untyped-def]
    for x in range(costs.shape[0]):
        new = cost_of_squared[np.uint64(squared[x] if squared[x] < last else last)]
        old = costs[x]
        unknown = (new >= np.uint8(253)) | (inflate_unknown & (new > np.uint8(0)))
        costs[x] = new if ((old == np.uint8(255)) & unknown) | (new > old) else old


@compiled()
def apply_costs(squared, cost_of_squared, inflate_unknown, costs):  # type: ignore[no-untyped-def]
    """Raise `costs` to the table's value; unknown cells give way as Nav2's inflation layer has it.

    The last value of the table is 0: rows that are far from everything stay as they are.
    """
    last = np.int32(cost_of_squared.shape[0] - 1)
    for y in range(costs.shape[0]):
        first, end = _ends(squared[y], last)
        if first <= end:
            _raise_row(
                squared[y, first : end + 1], cost_of_squared, last, inflate_unknown, costs[y, first : end + 1]
            )
