"""Blades on the graphics side: tiles of tufts around the camera, thinner far off."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.synth.model import Float64Array
from swardmap.synth.render.blades import FULL_PER_M2, TILE_M, tufts
from swardmap.synth.render.camera import RenderCamera
from swardmap.synth.render.context import Context, Program, layout_of, set_uniforms
from swardmap.synth.scene.lawn_look import STRAW
from swardmap.synth.terrain import Terrain

FULL_TO_M, END_M, GONE_M = 2.2, 10.0, 16.0
NEAR_M = 4.0
"""Nearer tufts have bent blades, farther ones straight triangles."""
MOST_TILES = 700


def share_at(distance_m: NDArray[np.floating]) -> Float64Array:
    """Share of the tufts that is drawn at a distance; the shader has the same."""
    d = np.maximum(np.asarray(distance_m, np.float64), FULL_TO_M)
    t = np.clip((d - END_M) / (GONE_M - END_M), 0, 1)
    share: Float64Array = (FULL_TO_M / d) ** 1.6 * (1 - t * t * (3 - 2 * t))
    return share


def tuft(blades: int, bent: bool) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Corners (across, along, blade) and triangles of a tuft."""
    across_along = [(-1, 0), (1, 0), (-1, 0.5), (1, 0.5), (0, 1)] if bent else [(-1, 0), (1, 0), (0, 1)]
    triangles = np.array([(0, 1, 2), (1, 3, 2), (2, 3, 4)] if bent else [(0, 1, 2)], np.uint32)
    n = len(across_along)
    corners = [(x, t, float(b)) for b in range(blades) for x, t in across_along]
    faces = np.concatenate([triangles + np.uint32(b * n) for b in range(blades)])
    return np.array(corners, np.float32), faces


class LawnPart:
    """The blades of one garden; tiles are made when the camera first comes near."""

    def __init__(self, context: Context, ground: Terrain, seed: int) -> None:
        self._context, self._ground, self._seed = context, ground, seed
        self._shapes = []
        for blades, bent in ((5, True), (5, False)):
            corners, faces = tuft(blades, bent)
            self._shapes.append((context.buffer(corners.tobytes()), context.buffer(faces.tobytes())))
        self._tiles: dict[tuple[int, int], tuple[Any, int, float]] = {}
        self._arrays: dict[tuple[int, int, int, int], Any] = {}

    def draw(self, program: Program, camera: RenderCamera) -> None:
        """Draw the blades that the camera sees."""
        set_uniforms(program, straw=STRAW)
        for tile, away in self._near(camera):
            buffer, count, _ = self._tile(tile)
            drawn = int(np.ceil(count * share_at(np.array(away))))
            if drawn == 0:
                continue
            corner = np.array([*tile, 0.0]) * TILE_M - camera.position_m
            set_uniforms(program, tile_rel=tuple(corner), full=float(count))
            self._array(program, tile, int(away > NEAR_M), buffer).render(instances=drawn)

    def _near(self, camera: RenderCamera) -> list[tuple[tuple[int, int], float]]:
        """Tiles in view, each with the distance of its nearest point; near ones first."""
        first = np.floor((camera.position_m[:2] - GONE_M) / TILE_M).astype(int)
        n = int(np.ceil(2 * GONE_M / TILE_M)) + 1
        j, i = (a.ravel() for a in np.mgrid[:n, :n])
        tiles = np.stack((i, j), axis=1) + first
        middle = (tiles + 0.5) * TILE_M
        z = self._ground.height_at(middle)
        centres = np.column_stack([middle, z])
        off = np.maximum(np.abs(middle - camera.position_m[:2]) - TILE_M / 2, 0)
        away = np.hypot(np.hypot(*off.T), np.maximum(camera.position_m[2] - z - 0.6, 0))
        seen = camera.sees(centres, np.full(len(tiles), TILE_M * 0.71 + 0.35)) & (away < GONE_M)
        order = np.flatnonzero(seen)[np.argsort(away[seen], kind="stable")]
        return [((int(tiles[k, 0]), int(tiles[k, 1])), float(away[k])) for k in order]

    def _tile(self, tile: tuple[int, int]) -> tuple[Any, int, float]:
        if tile not in self._tiles:
            if len(self._tiles) >= MOST_TILES:
                self._tiles.clear()
                self._arrays.clear()
            found = tufts(self._ground, self._seed, tile)
            data = found.tobytes() or bytes(28)
            self._tiles[tile] = (self._context.buffer(data), len(found), FULL_PER_M2 * TILE_M**2)
        return self._tiles[tile]

    def _array(self, program: Program, tile: tuple[int, int], shape: int, buffer: Any) -> Any:
        key = (program.glo, *tile, shape)
        if key not in self._arrays:
            corners, faces = self._shapes[shape]
            layout = [
                layout_of(program, corners, "corner:3f"),
                layout_of(program, buffer, "root:4f", "draw:2f", "look:4f1", each="/i"),
            ]
            self._arrays[key] = self._context.vertex_array(program, layout, faces)
        return self._arrays[key]
