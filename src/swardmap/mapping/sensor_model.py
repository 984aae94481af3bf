"""What one frame says of each cell, and what a cell makes of it: the sensor model of the living map.

Evidence is the log-odds of a hazard in thousandths, clamped, so that a map of hours still listens. A sighting
counts the less the farther away it was. Hazards need more to be cleared than to be marked; what was never
seen as grass is never free. This is the readable twin of `kernels.living`; a test holds both equal.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import EvidenceConfig
from swardmap.grid import GridSpec
from swardmap.labels import MapClass

PER_NAT = 1000
"""Evidence is kept in whole thousandths of a nat, so that sums are exact."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """State of a block of cells; the arrays are changed in place.

    Attributes:
        evidence: (h, w) int16 log-odds of a hazard in thousandths.
        person: (h, w) int16 evidence that the hazard is a person, 0 or more.
        classes: (h, w) uint8 MapClass that follows from the evidence so far.
    """

    evidence: NDArray[np.int16]
    person: NDArray[np.int16]
    classes: NDArray[np.uint8]

    @classmethod
    def unknown(cls, height: int, width: int) -> "Cells":
        """Cells of which nothing is known."""
        shape = height, width
        return cls(np.zeros(shape, np.int16), np.zeros(shape, np.int16), np.zeros(shape, np.uint8))

    def __getitem__(self, where: tuple[slice, slice]) -> "Cells":
        """A view of a part."""
        return Cells(self.evidence[where], self.person[where], self.classes[where])

    def copy(self) -> "Cells":
        """The same state in arrays of its own."""
        return Cells(self.evidence.copy(), self.person.copy(), self.classes.copy())

    @property
    def nbytes(self) -> int:
        """Memory of the arrays."""
        return self.evidence.nbytes + self.person.nbytes + self.classes.nbytes


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Where a frame was taken, in cells of its own grid.

    Attributes:
        x, y: of the camera, in cells from the grid's corner; may lie outside.
        half: distance in cells at which a sighting counts half.
        back: cells a ray that ends on the lawn passes low over, for each cell of its length.
    """

    x: float
    y: float
    half: float
    back: float

    @classmethod
    def of(
        cls,
        viewpoint_m: tuple[float, float, float],
        camera_height_m: float | None,
        spec: GridSpec,
        config: EvidenceConfig,
        lowest_m: float,
    ) -> "Viewpoint":
        """Viewpoint of a frame.

        Args:
            viewpoint_m: (x, y, z) of the camera in the frame of the grid.
            camera_height_m: of the camera above the ground; None = not known, and rays clear nothing.
            spec: the frame's grid.
            config: sensor model.
            lowest_m: lowest ground there may be, above the ground seen; the lower it is, the shorter the way
                that is cleared.
        """
        x, y, _ = viewpoint_m
        r, above = spec.resolution_m, 0.0 if camera_height_m is None else camera_height_m - lowest_m
        back = config.ray_height_m / above if above > config.ray_height_m else 0.0
        (x0, y0) = spec.origin_m
        return cls((x - x0) / r, (y - y0) / r, config.half_confidence_m / r, back)


def parameters(
    config: EvidenceConfig, min_points: int, min_grass_points: int | None = None
) -> NDArray[np.int64]:
    """The model as whole numbers, in the order both twins read them.

    Returns:
        (12,) int64: points a hazard needs; gains of obstacle, person, grass, ray; mark, free, clear,
        obstacle limit, person limit, free limit; points grass needs (None = as many).
    """
    nats = (
        config.obstacle_gain, config.person_gain, config.grass_gain, config.ray_gain, config.mark_at,
        config.free_at, config.clear_at, config.obstacle_limit, config.person_limit, config.free_limit,
    )  # fmt: skip
    scaled = [round(PER_NAT * value) for value in nats]
    return np.array([min_points, *scaled, min_grass_points or min_points], np.int64)


def cells_passed(
    points: NDArray[np.uint32], view: Viewpoint, min_points: int, min_grass_points: int | None = None
) -> NDArray[np.bool_]:
    """Cells that a ray passed low over on its way to grass; a hazard seen in this frame stops it.

    Args:
        points: (h, w, 4) points by MapClass.
        view: where the frame was taken.
        min_points: points a hazard needs.
        min_grass_points: points grass needs; None = min_points.
    """
    height, width = points.shape[:2]
    hazard = points[..., 2].astype(np.int64) + points[..., 3] >= min_points
    iy, ix = np.nonzero((points[..., 1] >= (min_grass_points or min_points)) & ~hazard)
    x, y = ix + 0.5, iy + 0.5
    dx, dy = view.x - x, view.y - y
    distance = np.sqrt(dx * dx + dy * dy)
    steps = np.floor(distance * view.back)
    passed = np.zeros((height, width), np.bool_)
    k = 1
    while len(x := x[keep := steps >= k]):
        y, dx, dy, distance, steps = y[keep], dx[keep], dy[keep], distance[keep], steps[keep]
        cx = np.floor(x + dx / distance * k).astype(np.int64)
        cy = np.floor(y + dy / distance * k).astype(np.int64)
        inside = (cx >= 0) & (cy >= 0) & (cx < width) & (cy < height)
        steps[~inside] = 0
        stopped = inside.copy()
        stopped[inside] = hazard[cy[inside], cx[inside]]
        steps[stopped] = 0
        go_on = inside & ~stopped
        passed[cy[go_on], cx[go_on]] = True
        k += 1
    return passed


def update_cells(
    points: NDArray[np.uint32],
    passed: NDArray[np.bool_],
    view: Viewpoint,
    corner: tuple[int, int],
    model: NDArray[np.int64],
    cells: Cells,
) -> None:
    """Let one frame's points speak to a block of cells.

    Args:
        points: (h, w, 4) points by MapClass in the block.
        passed: (h, w) of `cells_passed`.
        view: where the frame was taken.
        corner: (ix, iy) of the block in the frame's grid.
        model: of `parameters`.
        cells: the block; changed here.
    """
    k = model[0]
    grass, obstacle, person = (points[..., c].astype(np.int64) for c in (1, 2, 3))
    hazard = obstacle + person
    iy, ix = np.indices(points.shape[:2])
    dx, dy = ix + (corner[0] + 0.5) - view.x, iy + (corner[1] + 0.5) - view.y
    ratio = (dx * dx + dy * dy) / (view.half * view.half)
    confidence = 1.0 / (1.0 + ratio * ratio)  # the noise of stereo depth grows with the square of the range
    marked = hazard >= k
    lawn = ~marked & (grass >= model[11])
    crossed = ~marked & ~lawn & passed & (cells.evidence > 0)
    of_person = marked & ((person >= k) | (person >= obstacle))
    share = 0.5 + 0.5 * (hazard / np.maximum(hazard + grass, 1))
    gain = np.select([of_person, marked, lawn, crossed], [model[2], model[1], model[3], model[4]], 0)
    share = np.where(marked & ~of_person, share, 1.0)  # a person counts in full, however much lawn is beside
    step = np.floor(gain * confidence * share + 0.5).astype(np.int64)

    before, personal = cells.evidence.astype(np.int64), cells.person.astype(np.int64)
    personal = np.where(of_person, np.minimum(personal + step, model[9]), personal)
    personal = np.where(marked & ~of_person, np.maximum(personal - step, 0), personal)
    limit = np.where(personal > 0, model[9], model[8])
    after = np.where(marked, np.maximum(before, np.minimum(before + step, limit)), before)
    after = np.where(lawn, np.maximum(before - step, -model[10]), after)
    after = np.where(crossed, np.maximum(before - step, 0), after)

    direct, was_hazard = marked | lawn, cells.classes >= MapClass.OBSTACLE
    hazardous = np.where(was_hazard, after > -model[7], after >= model[5])
    classes = np.where(direct & was_hazard & ~hazardous, MapClass.GRASS, cells.classes)
    doubted = direct & ~was_hazard
    classes = np.where(doubted & (after > 0), MapClass.UNKNOWN, classes)
    classes = np.where(doubted & (after <= -model[6]), MapClass.GRASS, classes)
    named = np.where(personal > 0, MapClass.PERSON, MapClass.OBSTACLE)
    classes = np.where(direct & hazardous, named, classes)
    classes = np.where(crossed & was_hazard & (after == 0), MapClass.UNKNOWN, classes)
    forgotten = (direct | crossed) & (classes < MapClass.OBSTACLE) & (after <= 0)
    personal = np.where(forgotten, 0, personal)
    cells.evidence[:], cells.person[:], cells.classes[:] = after, personal, classes
