"""What the cells of one frame are, compiled (twin: swardmap.perception.plain.judge).

A loop for each array that is written: with few arrays to a loop, all of them vectorise.
"""

import numpy as np

from swardmap.kernels.compiled import compiled

GRASS, OBSTACLE, PERSON = np.uint8(1), np.uint8(2), np.uint8(3)


@compiled(inline="never")
def mark(above, below, raised, enough, marks, holes, doubted):  # type: ignore[no-untyped-def]
    """perception.geometric_obstacles.geometric_marks on (cells,) uint32; writes (cells,) bool."""
    for i in range(marks.shape[0]):
        marks[i] = (above[i] >= enough) | (below[i] >= enough) | (raised[i] >= enough)
    for i in range(holes.shape[0]):
        holes[i] = below[i] >= enough
    for i in range(doubted.shape[0]):
        doubted[i] = (raised[i] >= enough) & (above[i] < enough) & (below[i] < enough)


@compiled(inline="never")
def clear(seen, doubt, above, below, dropped, clear_below, level, out):  # type: ignore[no-untyped-def]
    """perception.observation.may_clear on (cells,) uint32, of a view whose ground is known."""
    for i in range(out.shape[0]):
        out[i] = np.float64(doubt[i]) <= clear_below * np.float64(seen[i])
    if level:
        for i in range(out.shape[0]):
            out[i] &= (above[i] | below[i] | dropped[i]) == 0


@compiled(inline="never")
def classify(points, clear, min_points, min_grass_points, classes):  # type: ignore[no-untyped-def]
    """grid.classify_cells on flat counters; writes (cells,) uint8 MapClass."""
    for i in range(classes.shape[0]):
        grass, obstacle, person = points[4 * i + 1], points[4 * i + 2], points[4 * i + 3]
        marked = np.uint32(obstacle + person) >= min_points  # not widened to 64 bits, as sums of Numba's are
        c = GRASS if clear[i] & (grass >= min_grass_points) else np.uint8(0)
        hazard = PERSON if (person >= min_points) | (person >= obstacle) else OBSTACLE
        classes[i] = hazard if marked else c


@compiled(inline="never")
def tell(points, clear, marks, min_points, always_enough, told):  # type: ignore[no-untyped-def]
    """observation.without_doubt, then geometric_obstacles.with_marks; flat counters (cells * 4,)."""
    none = np.uint32(0)
    for i in range(clear.shape[0]):
        unsure, grass = points[4 * i], points[4 * i + 1]
        obstacle, person = points[4 * i + 2], points[4 * i + 3]
        kept = clear[i] | (obstacle + person >= min_points)
        unsure = unsure if kept else np.uint32(unsure + grass)
        grass = grass if kept else none
        hazard = np.uint32(obstacle + grass)
        hazard = hazard if hazard > always_enough else always_enough
        told[4 * i], told[4 * i + 1] = unsure, none if marks[i] else grass
        told[4 * i + 2], told[4 * i + 3] = hazard if marks[i] else obstacle, person


@compiled(inline="never")
def tell_marks_alone(marks, always_enough, told):  # type: ignore[no-untyped-def]
    """The same without the network's classes."""
    for i in range(marks.shape[0]):
        told[4 * i], told[4 * i + 1], told[4 * i + 3] = np.uint32(0), np.uint32(0), np.uint32(0)
        told[4 * i + 2] = always_enough if marks[i] else np.uint32(0)


@compiled(inline="never")
def _grass_row(points, enough, grass, doubted):  # type: ignore[no-untyped-def]
    """Points of grass, no more than are enough, and whether any is in doubt; a rim of one cell about them."""
    for x in range(points.shape[0]):
        grass[x + 1] = min(points[x, 1], enough)
        doubted[x + 1] = np.uint8(1) if points[x, 0] > np.uint32(0) else np.uint8(0)


@compiled(inline="never")
def _along(grass, doubted, sums, doubts):  # type: ignore[no-untyped-def]
    """Points of grass in three cells along a row, and whether any is in doubt."""
    for x in range(sums.shape[0]):
        sums[x] = grass[x] + grass[x + 1] + grass[x + 2]
    for x in range(doubts.shape[0]):
        doubts[x] = doubted[x] | doubted[x + 1] | doubted[x + 2]


@compiled(inline="never")
def _marked_row(classes, marked, wide):  # type: ignore[no-untyped-def]
    """Whether one of seven cells along a row is marked; a rim of three about them."""
    for x in range(classes.shape[0]):
        marked[x + 3] = np.uint8(1) if classes[x] >= OBSTACLE else np.uint8(0)
    for x in range(wide.shape[0]):
        near = marked[x] | marked[x + 1] | marked[x + 2] | marked[x + 3]
        wide[x] = near | marked[x + 4] | marked[x + 5] | marked[x + 6]


@compiled(inline="never")
def _few_row(classes, points, sums, doubts, marks, enough, cleared):  # type: ignore[no-untyped-def]
    """Which cells of a row are cleared by the three rows of grass and doubt, the seven of marks about it.

    Returns:
        How many.
    """
    n = np.int32(0)
    for x in range(cleared.shape[0]):
        own, together = points[x, 1], np.uint32(sums[0, x] + sums[1, x] + sums[2, x])
        against = doubts[0, x] | doubts[1, x] | doubts[2, x] | classes[x]
        against |= marks[0, x] | marks[1, x] | marks[2, x] | marks[3, x]
        against |= marks[4, x] | marks[5, x] | marks[6, x]
        few = (own > np.uint32(0)) & (own < enough)
        cleared[x] = few & (together >= enough) & (np.uint8(against) == np.uint8(0))
        n = np.int32(n + cleared[x])
    return n


@compiled(inline="never")
def _clear_row(cleared, enough, classes, semantic, points):  # type: ignore[no-untyped-def]
    for x in range(cleared.shape[0]):
        if cleared[x]:
            classes[x], semantic[x], points[x, 1] = GRASS, GRASS, enough


@compiled()
def clear_together(classes, semantic, points, enough):  # type: ignore[no-untyped-def]
    """observation.clear_together, in place; twice (height, width) uint8, (height, width, 4) uint32.

    Along the rows first, then over three and seven of them.
    """
    height, width = classes.shape
    grass, doubted = np.zeros(width + 2, np.uint32), np.zeros(width + 2, np.uint8)
    marked = np.zeros(width + 6, np.uint8)
    sums, doubts = np.zeros((height + 2, width), np.uint32), np.zeros((height + 2, width), np.uint8)
    marks, cleared = np.zeros((height + 6, width), np.uint8), np.empty(width, np.bool_)
    for y in range(height):
        _grass_row(points[y], enough, grass, doubted)
        _along(grass, doubted, sums[y + 1], doubts[y + 1])
        _marked_row(classes[y], marked, marks[y + 3])
    for y in range(height):
        rows = sums[y : y + 3], doubts[y : y + 3], marks[y : y + 7]
        if _few_row(classes[y], points[y], *rows, enough, cleared) != 0:
            _clear_row(cleared, enough, classes[y], semantic[y], points[y])


@compiled(inline="never")
def raise_to_marks(semantic, marks, classes):  # type: ignore[no-untyped-def]
    """A mark of either is a mark; (cells,) uint8 MapClass."""
    for i in range(classes.shape[0]):
        c = OBSTACLE if marks[i] else np.uint8(0)
        classes[i] = c if c > semantic[i] else semantic[i]


@compiled()
def judge(  # type: ignore[no-untyped-def]
    counted, seen, doubt, above, below, raised, dropped, grounded, clear_below, min_points, min_grass_points,
    geometric, enough, always_enough, semantics, points, semantic, classes, marks,
):  # fmt: skip
    """What each cell is, by the network's classes and by depth.

    Args:
        counted: (cells * 4,) uint32 points by MapClass.
        seen: (cells,) uint32 points of any class.
        doubt: (cells,) uint32 sum of their hazard.
        above: (cells,) uint32 points above the ground.
        below: (cells,) uint32 points below it.
        raised: (cells,) uint32 points a little above it, and doubted.
        dropped: (cells,) uint32 readings above it that the filter removed.
        grounded: whether the ground is known; else nothing may clear.
        clear_below: largest mean hazard of a cell that may clear, in 255ths.
        min_points: points of obstacle and person that mark a cell.
        min_grass_points: points of grass that clear one.
        geometric: whether depth marks.
        enough: points off the ground that mark a cell.
        always_enough: points that a geometric mark has at least.
        semantics: whether the network is asked.
        points: (cells * 4,) uint32, written here: points by MapClass, as a map takes them in.
        semantic: (cells,) uint8, written here: MapClass by the network alone.
        classes: (cells,) uint8, written here: MapClass of all evidence.
        marks: (3, cells) bool, written here: geometric marks, holes, those that needed doubt.
    """
    may = np.zeros(seen.shape[0], np.bool_)
    if grounded:
        clear(seen, doubt, above, below, dropped, clear_below, geometric, may)
    if geometric:
        mark(above, below, raised, enough, marks[0], marks[1], marks[2])
    else:
        marks[:] = False
    classify(counted, may, min_points, min_grass_points, semantic)
    if semantics:
        tell(counted, may, marks[0], min_points, always_enough, points)
        raise_to_marks(semantic, marks[0], classes)
    else:
        tell_marks_alone(marks[0], always_enough, points)
        raise_to_marks(np.zeros(seen.shape[0], np.uint8), marks[0], classes)
