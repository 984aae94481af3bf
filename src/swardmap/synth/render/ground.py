"""The ground on the graphics side: tiles of its own triangles, coarser far off, and the plain around it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.synth.render.camera import RenderCamera
from swardmap.synth.render.context import Context, Program, set_uniforms
from swardmap.synth.render.detail import Details
from swardmap.synth.render.textures import SRGB8_ALPHA8, srgba_of
from swardmap.synth.terrain import Terrain

Int32Array = NDArray[np.int32]

TILE = 32
STEPS = ((4.0, 2), (9.0, 4), (np.inf, 8))
"""Up to this distance (m), every how many texels there is a vertex."""
PLAIN_M = 90.0
NEAREST, LINEAR, MIPMAP = 0x2600, 0x2601, 0x2703


def tile_grid(step: int) -> tuple[Int32Array, NDArray[np.uint32]]:
    """Vertices (x, y, skirt) and triangles of a tile; a skirt hangs from its border.

    Squares are cut from (x + 1, y) to (x, y + 1), as `Terrain.height_at` has it.
    """
    n = TILE // step + 1
    y, x = np.mgrid[:n, :n]
    at = np.arange(n * n, dtype=np.uint32).reshape(n, n)
    a, b, c, d = at[:-1, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel()
    faces = [np.stack((a, b, c), axis=1), np.stack((b, d, c), axis=1)]
    border = np.concatenate([at[0], at[1:, -1], at[-1, -2::-1], at[-2::-1, 0]])
    hung = n * n + np.arange(len(border), dtype=np.uint32)
    faces += [
        np.stack((border[:-1], hung[:-1], border[1:]), axis=1),
        np.stack((border[1:], hung[:-1], hung[1:]), axis=1),
    ]
    vertices = np.stack((x.ravel() * step, y.ravel() * step, np.zeros(n * n, np.int64)), axis=1)
    skirt = vertices[border] + [0, 0, 1]
    return np.concatenate([vertices, skirt]).astype(np.int32), np.concatenate(faces)


def plain(nx: int, ny: int, reach: int) -> tuple[Int32Array, NDArray[np.uint32]]:
    """Vertices and triangles from the border of the raster outward, as level as the border is there."""
    x, y = _knots(nx), _knots(ny)
    patches = [
        (x, np.array([-reach, 0])), (x, np.array([ny - 1, ny - 1 + reach])),
        (np.array([-reach, 0]), y), (np.array([nx - 1, nx - 1 + reach]), y),
    ]  # fmt: skip
    patches += [
        (np.array(along), np.array(across))
        for along in ((-reach, 0), (nx - 1, nx - 1 + reach))
        for across in ((-reach, 0), (ny - 1, ny - 1 + reach))
    ]
    vertices, faces, first = [], [], 0
    for along, across in patches:
        grid = np.stack(np.meshgrid(along, across), axis=-1).reshape(-1, 2)
        at = first + np.arange(len(grid), dtype=np.uint32).reshape(len(across), len(along))
        a, b, c, d = at[:-1, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel()
        vertices.append(np.concatenate([grid, np.zeros((len(grid), 1), np.int64)], axis=1))
        faces += [np.stack((a, b, c), axis=1), np.stack((b, d, c), axis=1)]
        first += len(grid)
    return np.concatenate(vertices).astype(np.int32), np.concatenate(faces).astype(np.uint32)


def _knots(n: int) -> NDArray[np.int64]:
    return np.unique(np.append(np.arange(0, n, 8), n - 1))


class GroundPart:
    """One ground, uploaded.

    Args:
        context: where.
        ground: what.
        details: of its surfaces.
    """

    def __init__(self, context: Context, ground: Terrain, details: Details) -> None:
        self._context, self._ground = context, ground
        ny, nx = ground.height_m.shape
        self._size = (nx, ny)
        self._height = self._raster(ground.height_m, 1, "f4", NEAREST)
        self._lawn = self._raster(ground.lawn_m, 1, "f4", NEAREST)
        self._surface = self._raster(ground.surface, 1, "u1", NEAREST)
        self._albedo = context.texture(
            (nx, ny), 4, srgba_of(ground.albedo).tobytes(), internal_format=SRGB8_ALPHA8
        )
        self._albedo.build_mipmaps()
        self._albedo.filter = (MIPMAP, LINEAR)
        self._albedo.repeat_x = self._albedo.repeat_y = False
        self._details = details
        lawn = ground.lawn_m > 0
        self.lawn_color: NDArray[np.float32] = (
            ground.albedo[lawn].mean(axis=0) if lawn.any() else ground.albedo.mean(axis=(0, 1))
        )
        self._tiles, self._centres, self._radii = self._bounds()
        self._grids = [self._uploaded(tile_grid(step)) for _, step in STEPS]
        self._plain = self._uploaded(plain(nx, ny, int(PLAIN_M / ground.texel_m)))
        self._instances = [context.buffer(reserve=8 * len(self._tiles)) for _ in STEPS]
        self._origin = context.buffer(np.zeros(2, np.int32).tobytes())
        self._arrays: dict[int, tuple[list[Any], Any]] = {}

    def draw(self, program: Program, camera: RenderCamera, units: dict[str, int]) -> None:
        """Draw what the camera sees of it.

        Args:
            program: with which.
            camera: from where.
            units: texture units of the rasters by name.
        """
        self.bind(program, camera, units)
        tiles, plain_array = self._arrays_of(program)
        nx, ny = self._size
        set_uniforms(program, low=(0, 0), high=(nx - 1, ny - 1))
        seen = camera.sees(self._centres, self._radii)
        away = np.linalg.norm(self._centres - camera.position_m, axis=1) - self._radii
        nearest = -np.inf
        for (reach, _), buffer, array in zip(STEPS, self._instances, tiles, strict=True):
            chosen = self._tiles[seen & (away > nearest) & (away <= reach)]
            nearest = reach
            if len(chosen):
                buffer.write(chosen.tobytes())
                array.render(instances=len(chosen))
        far = 1 << 20
        set_uniforms(program, low=(-far, -far), high=(far, far))
        plain_array.render(instances=1)

    def bind(self, program: Program, camera: RenderCamera, units: dict[str, int]) -> None:
        """Give a program the rasters, and where the camera is on them."""
        rasters = {
            "height_map": self._height, "lawn_map": self._lawn, "surface_map": self._surface,
            "albedo_map": self._albedo, "details": self._details.texture,
        }  # fmt: skip
        for name, raster in rasters.items():
            raster.use(units[name])
        texel = self._ground.texel_m
        grid = (camera.position_m[:2] - self._ground.origin_m) / texel - 0.5
        cell = np.floor(grid)
        set_uniforms(
            program, texel_m=texel, camera_cell=(int(cell[0]), int(cell[1])),
            camera_offset=tuple((grid - cell) * texel), tile_m=self._details.tile_m,
            lawn_color=tuple(self.lawn_color), **units,
        )  # fmt: skip

    def _raster(self, values: NDArray[Any], components: int, dtype: str, filtering: int) -> Any:
        ny, nx = values.shape[:2]
        data = np.ascontiguousarray(values).tobytes()
        texture = self._context.texture((nx, ny), components, data, dtype=dtype, alignment=1)
        texture.filter = (filtering, filtering)
        texture.repeat_x = texture.repeat_y = False
        return texture

    def _bounds(self) -> tuple[Int32Array, NDArray[np.float64], NDArray[np.float64]]:
        """First texel of each tile, and the spheres around them."""
        nx, ny = self._size
        z, texel = self._ground.height_m, self._ground.texel_m
        j, i = (a.ravel() for a in np.mgrid[0 : ny - 1 : TILE, 0 : nx - 1 : TILE])
        rows, columns = np.arange(0, ny - 1, TILE), np.arange(0, nx - 1, TILE)
        low = np.minimum.reduceat(np.minimum.reduceat(z, rows, axis=0), columns, axis=1).ravel() - 0.2
        high = np.maximum.reduceat(np.maximum.reduceat(z, rows, axis=0), columns, axis=1).ravel() + 0.05
        edge = TILE * texel
        x = self._ground.origin_m[0] + (i + 0.5) * texel + edge / 2
        y = self._ground.origin_m[1] + (j + 0.5) * texel + edge / 2
        radii = np.hypot(edge * 0.71, (high - low) / 2)
        return (
            np.stack((i, j), axis=1).astype(np.int32),
            np.stack((x, y, (low + high) / 2), axis=1).astype(np.float64),
            radii.astype(np.float64),
        )

    def _uploaded(self, shape: tuple[Int32Array, NDArray[np.uint32]]) -> tuple[Any, Any]:
        vertices, faces = shape
        return self._context.buffer(vertices.tobytes()), self._context.buffer(faces.tobytes())

    def _arrays_of(self, program: Program) -> tuple[list[Any], Any]:
        if program.glo not in self._arrays:

            def array(grid: tuple[Any, Any], instances: Any) -> Any:
                layout = [(grid[0], "3i", "local"), (instances, "2i/i", "tile")]
                return self._context.vertex_array(program, layout, grid[1])

            tiles = [array(grid, own) for grid, own in zip(self._grids, self._instances, strict=True)]
            self._arrays[program.glo] = (tiles, array(self._plain, self._origin))
        return self._arrays[program.glo]
