"""The types of a garden: what they refuse, and the ground against a brute-force reading of its triangles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swardmap.errors import InvalidValueError
from swardmap.labels import PERSON
from swardmap.synth.model import Float64Array, Garden, Material, Mesh, Model, Texture, Thing
from swardmap.synth.shapes import box, placed
from swardmap.synth.terrain import Terrain


def ground_of(height: np.ndarray, lawn: np.ndarray | None = None, texel: float = 0.5) -> Terrain:
    blank = np.zeros(height.shape, np.float32)
    lawn = np.ones(height.shape, np.float32) if lawn is None else lawn.astype(np.float32)
    return Terrain(
        (-1.0, 2.0), texel, height.astype(np.float32), lawn, blank.astype(np.uint8),
        np.zeros((*height.shape, 3), np.float32), blank, blank, blank,
    )  # fmt: skip


def barycentric_height(ground: Terrain, x: float, y: float) -> float | None:
    """The height of the one triangle that holds a point, found by trying all."""
    ny, nx = ground.height_m.shape

    def vertex(i: int, j: int) -> Float64Array:
        x0, y0 = ground.origin_m
        return np.array(
            [x0 + (i + 0.5) * ground.texel_m, y0 + (j + 0.5) * ground.texel_m, ground.height_m[j, i]],
            np.float64,
        )

    for j in range(ny - 1):
        for i in range(nx - 1):
            for corners in (
                (vertex(i, j), vertex(i + 1, j), vertex(i, j + 1)),
                (vertex(i + 1, j + 1), vertex(i, j + 1), vertex(i + 1, j)),
            ):
                a, b, c = corners
                share = np.linalg.solve(
                    np.stack([[*a[:2], 1], [*b[:2], 1], [*c[:2], 1]], axis=1), np.array([x, y, 1.0])
                )
                if (share >= -1e-9).all():
                    return float(share @ [a[2], b[2], c[2]])
    return None


@settings(max_examples=80, deadline=None)
@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(0, 5))
def test_height_is_that_of_the_triangle(u: float, v: float, seed: int) -> None:
    ground = ground_of(np.random.default_rng(seed).normal(size=(4, 5)))
    x, y = -1.0 + 0.25 + u * 2.0, 2.0 + 0.25 + v * 1.5
    expected = barycentric_height(ground, x, y)
    assert expected is not None
    assert ground.height_at(np.array([[x, y]]))[0] == pytest.approx(expected, abs=1e-6)


def test_height_of_a_plane_is_the_plane_and_beyond_the_raster_its_edge() -> None:
    j, i = np.mgrid[0:6, 0:8]
    ground = ground_of(0.3 * (i + 0.5) * 0.5 - 0.2 * (j + 0.5) * 0.5)
    xy = np.random.default_rng(1).uniform((-0.7, 2.3), (2.7, 4.7), (50, 2))
    np.testing.assert_allclose(ground.height_at(xy), 0.3 * (xy[:, 0] + 1) - 0.2 * (xy[:, 1] - 2), atol=1e-6)
    far = ground.height_at(np.array([[-50.0, 2.75], [50.0, 2.75]]))
    np.testing.assert_allclose(far, ground.height_m[1, [0, -1]], atol=1e-6)


def test_lawn_is_where_the_bilinear_distance_is_positive() -> None:
    lawn = np.random.default_rng(2).normal(size=(5, 6))
    ground = ground_of(np.zeros((5, 6)), lawn)
    xy = np.random.default_rng(3).uniform((-0.75, 2.25), (1.75, 4.25), (400, 2))
    at = (xy - [-1.0, 2.0]) / 0.5 - 0.5
    i, j = np.floor(at).astype(int).T
    a, b = (at - np.floor(at)).T
    stored = ground.lawn_m.astype(np.float64)
    value = (
        stored[j, i] * (1 - a) * (1 - b) + stored[j, i + 1] * a * (1 - b)
        + stored[j + 1, i] * (1 - a) * b + stored[j + 1, i + 1] * a * b
    )  # fmt: skip
    clear = np.abs(value) > 1e-9
    np.testing.assert_array_equal(ground.is_lawn(xy)[clear], value[clear] > 0)
    assert 0 < ground.is_lawn(xy).sum() < 400


def test_a_ground_whose_rasters_differ_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="expected lawn_m of"):
        ground_of(np.zeros((4, 5)), np.zeros((4, 4)))
    with pytest.raises(InvalidValueError, match="positive texel"):
        ground_of(np.zeros((4, 5)), texel=0.0)


def test_meshes_textures_and_things_are_checked() -> None:
    good = box((1, 1, 1))
    with pytest.raises(InvalidValueError, match="normals of shape"):
        Mesh(good.xyz, good.normals[:-1], good.uv, good.faces, Material())
    with pytest.raises(InvalidValueError, match="float64"):
        Mesh(good.xyz.astype(np.float64), good.normals, good.uv, good.faces, Material())
    with pytest.raises(InvalidValueError, match="finite"):
        Mesh(np.full_like(good.xyz, np.nan), good.normals, good.uv, good.faces, Material())
    with pytest.raises(InvalidValueError, match="uint8"):
        Texture("t", np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(InvalidValueError, match="4 x 4"):
        Thing(Model("m", (good,)), "ball", np.full((4, 4), np.nan))


def test_a_garden_gives_those_who_move_last() -> None:
    model = Model("m", (box((1, 1, 1)),))

    class Walking:
        def at(self, stamp_ns: int) -> Thing:
            return Thing(model, "person", placed(stamp_ns * 1e-9, 0), PERSON)

    garden = Garden(
        "g", 0, ground_of(np.zeros((4, 4))), (Thing(model, "box"),), np.zeros((3, 2)), (Walking(),)
    )
    first, second = garden.at(2_000_000_000)
    assert (first.kind, second.kind) == ("box", "person")
    assert second.T_map_model[0, 3] == pytest.approx(2.0)
