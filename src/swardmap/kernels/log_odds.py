"""The log-odds map's two loops, compiled: rays that passed, and evidence (twins in mapping.sensor_model).

Float64 throughout and whole numbers for evidence, so that both twins agree bit for bit.
"""

import math

import numpy as np

from swardmap.kernels.compiled import compiled


@compiled()
def cells_passed(points, x, y, back, min_points, min_grass_points, passed):  # type: ignore[no-untyped-def]
    """evidence.cells_passed.

    Args:
        points: (h, w, 4) uint32 points by MapClass.
        x: of the camera in cells of the window.
        y: of the camera in cells of the window.
        back: low part of a ray, as a share of its length.
        min_points: points a hazard needs.
        min_grass_points: points grass needs.
        passed: (h, w) bool, all False; set here.
    """
    height, width = passed.shape
    for iy in range(height):
        for ix in range(width):
            n_hazard = np.int64(points[iy, ix, 2]) + points[iy, ix, 3]
            if points[iy, ix, 1] < min_grass_points or n_hazard >= min_points:
                continue
            dx, dy = x - (ix + 0.5), y - (iy + 0.5)
            distance = math.sqrt(dx * dx + dy * dy)
            steps = math.floor(distance * back)
            for k in range(1, steps + 1):
                cx = math.floor(ix + 0.5 + dx / distance * k)
                cy = math.floor(iy + 0.5 + dy / distance * k)
                if cx < 0 or cy < 0 or cx >= width or cy >= height:
                    break
                if np.int64(points[cy, cx, 2]) + points[cy, cx, 3] >= min_points:
                    break
                passed[cy, cx] = True


@compiled()
def _class_seen(c, evidence, person, mark, free, clear):  # type: ignore[no-untyped-def]
    """Class of a cell that was seen: a hazard until cleared, marked, free, in doubt, or as before."""
    hazard = c >= 2
    if hazard and evidence <= -clear:
        return np.uint8(1)
    if hazard or evidence >= mark:
        return np.uint8(3) if person > 0 else np.uint8(2)
    if evidence <= -free:
        return np.uint8(1)
    return np.uint8(0) if evidence > 0 else c


@compiled()
def update_cells(  # type: ignore[no-untyped-def]
    points, passed, x, y, half, corner_x, corner_y, model, evidence, person, classes
):
    """evidence.update_cells.

    Args:
        points: (h, w, 4) uint32 points by MapClass in the block.
        passed: (h, w) bool.
        x: of the camera in cells of the frame's grid.
        y: of the camera in cells of the frame's grid.
        half: distance in cells at which a sighting counts half.
        corner_x: first column of the block in the frame's grid.
        corner_y: first row of the block in the frame's grid.
        model: (12,) int64 of `evidence.parameters`.
        evidence: (h, w) int16; changed here.
        person: (h, w) int16; changed here.
        classes: (h, w) uint8; changed here.
    """
    needed, of_obstacle, of_person, of_grass, of_ray, mark, free, clear = model[:8]
    obstacle_limit, person_limit, free_limit, needed_grass = model[8:]
    for iy in range(classes.shape[0]):
        for ix in range(classes.shape[1]):
            n_grass = np.int64(points[iy, ix, 1])
            n_obstacle, n_person = np.int64(points[iy, ix, 2]), np.int64(points[iy, ix, 3])
            n_hazard = n_obstacle + n_person
            before = int(evidence[iy, ix])
            marked, lawn = n_hazard >= needed, n_grass >= needed_grass
            if not marked and not lawn and not (passed[iy, ix] and before > 0):
                continue
            dx, dy = ix + (corner_x + 0.5) - x, iy + (corner_y + 0.5) - y
            ratio = (dx * dx + dy * dy) / (half * half)
            confidence = 1.0 / (1.0 + ratio * ratio)
            personal, c = int(person[iy, ix]), classes[iy, ix]
            if marked:
                seen_person = n_person >= needed or n_person >= n_obstacle
                gain = of_person if seen_person else of_obstacle
                share = 1.0 if seen_person else 0.5 + 0.5 * (n_hazard / (n_hazard + n_grass))
                step = math.floor(gain * confidence * share + 0.5)
                personal = min(personal + step, person_limit) if seen_person else max(personal - step, 0)
                limit = person_limit if personal > 0 else obstacle_limit
                after = max(before, min(before + step, limit))
            elif lawn:
                after = max(before - math.floor(of_grass * confidence + 0.5), -free_limit)
            else:
                after = max(before - math.floor(of_ray * confidence + 0.5), 0)
            if marked or lawn:
                c = _class_seen(c, after, personal, mark, free, clear)
            elif c >= 2 and after == 0:
                c = np.uint8(0)
            if c < 2 and after <= 0:
                personal = 0
            evidence[iy, ix], person[iy, ix], classes[iy, ix] = after, personal, c
