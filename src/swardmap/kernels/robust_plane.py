"""The plane through most points, compiled (twin: perception.ground_surface._robust_plane).

Float64 in the order of operations of the twin. Sums run in LANES lanes, so that they vectorise in both.
"""

import numpy as np

from swardmap.kernels.compiled import compiled
from swardmap.kernels.constants import LANES

SUMS = 9
FAR_OFF = 1e30
"""Height of what fills up the last lanes: it weighs nothing."""


@compiled()
def fill_up(points, n):  # type: ignore[no-untyped-def]
    """Points up to whole lanes behind the first n, which weigh nothing."""
    for i in range(n, (n + LANES - 1) // LANES * LANES):
        points[0, i], points[1, i], points[2, i] = 0.0, 0.0, FAR_OFF


@compiled(inline="never")
def _sum_round(points, at, a, b, c, near, lanes):  # type: ignore[no-untyped-def]
    """Add the weighted sums of LANES points to `lanes`: Tukey's biweight, and the normal equations."""
    for i in range(LANES):
        x, y = points[0, at + i], points[1, at + i]
        off = points[2, at + i] - (a * x + b * y + c)
        t = off * near
        w = 1.0 - t * t
        w = w if w > 0.0 else 0.0
        w = w * w
        wx, wy, wo = w * x, w * y, w * off
        lanes[i] += wx * x
        lanes[LANES + i] += wx * y
        lanes[2 * LANES + i] += wy * y
        lanes[3 * LANES + i] += wx
        lanes[4 * LANES + i] += wy
        lanes[5 * LANES + i] += w
        lanes[6 * LANES + i] += wo * x
        lanes[7 * LANES + i] += wo * y
        lanes[8 * LANES + i] += wo


@compiled()
def robust_plane(points, n, plane, near_m):  # type: ignore[no-untyped-def]
    """Plane through most of the (3, n) points x, y, z, round by round; filled up to whole lanes."""
    lanes, s = np.empty(SUMS * LANES), np.empty(SUMS)
    for r in range(near_m.shape[0]):
        lanes[:] = 0.0
        for at in range(0, n, LANES):
            _sum_round(points, at, plane[0], plane[1], plane[2], 1.0 / (3.0 * near_m[r]), lanes)
        for k in range(SUMS):
            total = 0.0
            for i in range(LANES):
                total += lanes[k * LANES + i]
            s[k] = total
        ridge = 1e-6 * n
        xx, xy, yy, wx, wy, w = s[0] + ridge, s[1], s[2] + ridge, s[3], s[4], s[5] + ridge
        l1, l2 = xy / xx, wx / xx
        yy2, wy2 = yy - l1 * xy, wy - l1 * wx
        l3 = wy2 / yy2
        right2 = s[7] - l1 * s[6]
        up = (s[8] - l2 * s[6] - l3 * right2) / (w - l2 * wx - l3 * wy2)
        along = (right2 - wy2 * up) / yy2
        plane[0] += (s[6] - xy * along - wx * up) / xx
        plane[1] += along
        plane[2] += up
