"""The true map against the closed forms of boxes, cylinders and balls, and against rays and samples."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.geometry import Intrinsics, Pose, deproject, mount_pose
from swardmap.grid import GridSpec
from swardmap.labels import GRASS, OTHER, PERSON, LabelClass, MapClass
from swardmap.synth import analytic
from swardmap.synth.config import MapConfig
from swardmap.synth.model import Actor, Garden, Material, Mesh, Model, Thing
from swardmap.synth.shapes import box, cylinder, mesh_of, placed, sphere
from swardmap.synth.terrain import Surface, Terrain
from swardmap.synth.truth import frame_map, ground_classes, scene_map

MARGIN = 2e-5
LOT = np.array([[-3, -3], [3, -3], [3, 3], [-3, 3.0]])


def ground(size_m: float = 6.0, texel_m: float = 0.1, lawn_m: NDArray[np.float32] | None = None,
           height_m: NDArray[np.float32] | None = None) -> Terrain:  # fmt: skip
    n = round(size_m / texel_m)
    ones = np.ones((n, n), np.float32)
    return Terrain(
        (-size_m / 2, -size_m / 2), texel_m,
        0 * ones if height_m is None else height_m, ones if lawn_m is None else lawn_m,
        np.full((n, n), Surface.LAWN, np.uint8), np.ones((n, n, 3), np.float32), 0 * ones, 0 * ones, 0 * ones,
    )  # fmt: skip


def garden(*things: Thing, on: Terrain | None = None, actors: tuple[Actor, ...] = ()) -> Garden:
    return Garden("test", 0, on or ground(), things, LOT, actors)


def thing(mesh: Mesh, x: float = 0, y: float = 0, z: float = 0, yaw: float = 0, label: LabelClass = OTHER,
          scale: float = 1.0) -> Thing:  # fmt: skip
    return Thing(Model("shape", (mesh,)), "shape", placed(x, y, z, yaw, scale), label)


def closed_form(spec: GridSpec, *solids: object) -> NDArray[np.uint8]:
    return analytic.true_map(analytic.Scene(tuple(solids)), spec).classes  # type: ignore[arg-type]


@settings(max_examples=60, deadline=None)
@given(
    xy=st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
    size=st.tuples(st.floats(0.02, 1.5), st.floats(0.02, 1.5), st.floats(0.05, 3)),
    yaw=st.floats(-180, 180),
    base=st.floats(0, 2.5).filter(lambda z: abs(z - 2.0) > 1e-3),
)
def test_boxes_cover_the_cells_of_their_closed_form(
    xy: tuple[float, float], size: tuple[float, float, float], yaw: float, base: float
) -> None:
    made = scene_map(garden(thing(box(size), *xy, base, np.deg2rad(yaw))), MapConfig(min_height_m=0.0))
    smaller, larger = (
        closed_form(made.spec, analytic.Box(xy, (size[0] + d, size[1] + d, size[2] + d), yaw, base - d / 2))
        for d in (-MARGIN, MARGIN)
    )
    assert (smaller <= made.classes).all()
    assert (made.classes <= larger).all()


@settings(max_examples=40, deadline=None)
@given(
    xy=st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
    radius=st.floats(0.02, 0.9),
    height=st.floats(0.05, 3),
    kind=st.sampled_from(["cylinder", "ball"]),
)
def test_round_things_cover_the_cells_of_their_closed_form(
    xy: tuple[float, float], radius: float, height: float, kind: str
) -> None:
    """A polygon of 120 sides lies within r (1 - cos(pi / 120)) = r 0.00034 of the circle."""

    def solid(d: float) -> analytic.Cylinder | analytic.Ellipsoid:
        if kind == "cylinder":
            return analytic.Cylinder(xy, radius * (1 + d) + d, height)
        return analytic.sphere((*xy, radius), radius * (1 + 4 * d) + d)

    mesh = cylinder(radius, height, 120) if kind == "cylinder" else sphere(radius, 60, 120)
    made = scene_map(garden(thing(mesh, *xy)), MapConfig(min_height_m=0.0))
    assert (closed_form(made.spec, solid(-4e-4)) <= made.classes).all()
    assert (made.classes <= closed_form(made.spec, solid(1e-5))).all()


def test_what_hangs_high_is_driven_under_and_what_is_flat_is_driven_over() -> None:
    things = (
        thing(box((1, 1, 0.5)), -1.5, 0, 2.1),
        thing(box((1, 1, 0.5)), 1.5, 0, 1.9),
        thing(box((1, 1, 0.008)), 0, 2),
    )
    made = scene_map(garden(*things))
    cells = made.spec.cell_of([[-1.5, 0.0], [1.5, 0.0], [0.0, 2.0]])
    at = made.classes[cells[:, 1], cells[:, 0]]
    assert at.tolist() == [MapClass.GRASS, MapClass.OBSTACLE, MapClass.GRASS]


def test_heights_count_from_the_ground_beneath() -> None:
    slope = np.tile(np.linspace(0, 1.2, 60, dtype=np.float32), (60, 1))
    on = ground(height_m=slope)
    z = float(on.height_at(np.array([[2.0, 0.0]]))[0])
    things = (thing(box((0.3, 0.3, 0.1)), 2.0, 0, z + 1.5), thing(box((0.3, 0.3, 0.1)), -2.0, 0, z + 1.5))
    made = scene_map(garden(*things, on=on))
    cells = made.spec.cell_of([[2.0, 0.0], [-2.0, 0.0]])
    assert made.classes[cells[0, 1], cells[0, 0]] == MapClass.OBSTACLE
    assert made.classes[cells[1, 1], cells[1, 0]] == MapClass.GRASS, "more than 2 m above the low end"


def test_a_tall_closed_thing_is_solid_and_a_house_without_a_floor_too() -> None:
    roof = mesh_of(
        [[-1, -1, 2.5], [1, -1, 2.5], [1, 1, 2.5], [-1, 1, 2.5]], np.tile([0, 0, 1.0], (4, 1)),
        np.zeros((4, 2)), [[0, 1, 2], [0, 2, 3]],
    )  # fmt: skip
    walls = [box((2, 0.1, 2.5)), box((0.1, 2, 2.5))]
    house = (
        thing(walls[0], y=-0.95),
        thing(walls[0], y=0.95),
        thing(walls[1], x=-0.95),
        thing(walls[1], x=0.95),
    )
    for things in ((thing(box((2, 2, 3.0))),), (*house, thing(roof))):
        made = scene_map(garden(*things))
        assert made.count(MapClass.OBSTACLE) == 40 * 40
    leaves = mesh_of(roof.xyz, roof.normals, roof.uv, roof.faces, Material(cutout=True))
    assert scene_map(garden(thing(leaves))).count(MapClass.OBSTACLE) == 0, (
        "a crown does not fill what is below"
    )


def test_a_gap_too_small_for_a_wheel_is_filled_and_a_yard_is_not() -> None:
    def ring(inner: float) -> tuple[Thing, ...]:
        long = inner + 0.2
        sides = [(0, inner / 2 + 0.05), (0, -inner / 2 - 0.05)]
        return tuple(thing(box((long, 0.1, 0.4)), x, y) for x, y in sides) + tuple(
            thing(box((0.1, long, 0.4)), y, x) for x, y in sides
        )

    for inner, free in ((0.6, False), (2.0, True)):
        made = scene_map(garden(*ring(inner)))
        cell = made.spec.cell_of([0.01, 0.01])
        assert (made.classes[cell[1], cell[0]] == MapClass.GRASS) == free


def test_person_beats_obstacle_beats_grass_and_grass_marks_nothing() -> None:
    things = (
        thing(box((0.4, 0.4, 1.0)), label=PERSON),
        thing(box((1.0, 1.0, 0.5))),
        thing(box((1.0, 1.0, 0.5)), 2.0, label=GRASS),
    )
    made = scene_map(garden(*things))
    assert made.count(MapClass.PERSON) == 64
    assert made.count(MapClass.OBSTACLE) == 400 - 64
    assert made.count(MapClass.GRASS) == made.classes.size - 400


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.sampled_from([0.05, 0.1, 0.03]))
def test_a_cell_is_grass_only_if_all_its_samples_are_lawn(seed: int, resolution_m: float) -> None:
    rng = np.random.default_rng(seed)
    coarse = rng.normal(size=(8, 8))
    lawn = np.kron(coarse, np.ones((8, 8)))[:60, :60].astype(np.float32)
    on = ground(lawn_m=lawn)
    spec = GridSpec(resolution_m, 40, 30, (-1.5, -1.0))
    made = ground_classes(on, spec)
    n = int(np.ceil(resolution_m / 0.025 - 1e-9))
    for iy, ix in rng.integers(0, (30, 40), (60, 2)):
        x, y = np.meshgrid(*(spec.origin_m[k] + (i + np.linspace(0, 1, n + 1)) * resolution_m
                             for k, i in enumerate((ix, iy))))  # fmt: skip
        lawn_here = on.is_lawn(np.stack((x.ravel(), y.ravel()), 1) + 0.0)
        expected = MapClass.GRASS if lawn_here.all() else MapClass.OBSTACLE
        if not lawn_here.all() and lawn_here.sum() >= lawn_here.size - 1:
            continue  # one sample on the very border, subject to rounding
        assert made[iy, ix] == expected


def test_beyond_the_raster_nothing_is_known() -> None:
    spec = GridSpec(0.1, 80, 80, (-4.0, -4.0))
    known = ground_classes(ground(), spec) != MapClass.UNKNOWN
    assert known.sum() == 60 * 60
    assert known[10:70, 10:70].all()
    made = scene_map(garden(thing(box((2, 2, 1)), 3.0), on=ground(texel_m=0.1)))
    assert made.spec.extent_m == pytest.approx((-3, 3, -3, 3))


class Walker:
    def at(self, stamp_ns: int) -> Thing:
        return thing(box((0.2, 0.2, 1.5)), 0.5 + stamp_ns * 1e-9, 0.0, label=PERSON)


CAMERA = Intrinsics(80, 60, 57.0, 57.0, 39.5, 29.5)


def test_a_frame_shows_who_is_where_at_its_time_hidden_or_not() -> None:
    wall = thing(box((0.1, 3.0, 1.5)), 0.2)
    walled = garden(wall, actors=(Walker(),))
    scene = scene_map(walled)
    assert scene.count(MapClass.PERSON) == 0
    pose = mount_pose(1.0, 20.0, parent="map", xy_m=(-2.5, 0.0))
    for stamp_ns in (0, 1_000_000_000):
        seen = frame_map(walled, scene, CAMERA, pose, stamp_ns)
        iy, ix = np.nonzero(seen.classes == MapClass.PERSON)
        x, y = seen.spec.center_of(np.stack((ix, iy), 1)).T
        assert len(x) == 16
        assert x.mean() == pytest.approx(0.5 + stamp_ns * 1e-9, abs=1e-6)
        assert y.mean() == pytest.approx(0, abs=1e-6)
        assert seen.stamp_ns == stamp_ns


def test_a_frame_knows_what_lies_on_the_ground_it_looks_at() -> None:
    open_lawn = garden()
    pose = mount_pose(1.0, 25.0, yaw_deg=30, parent="map", xy_m=(-2.0, -2.0))
    seen = frame_map(open_lawn, scene_map(open_lawn), CAMERA, pose, 0, MapConfig(range_m=3.0))
    known = seen.classes == MapClass.GRASS
    # every ray that meets the ground within range lands on a known cell, or within a pixel of its border
    v, u = np.mgrid[:60, :80]
    ray = deproject(np.ones((60, 80), np.float32), CAMERA).reshape(-1, 3)
    down = ray @ pose.matrix[2, :3]
    depth = np.where(down < 0, -1.0 / np.minimum(down, -1e-9), np.inf)
    inner = ((u > 1) & (u < 78) & (v > 1) & (v < 58)).ravel() & (depth < 2.9)
    xy = pose.apply(ray[inner] * depth[inner, None])[:, :2]
    inner_xy = xy[(np.abs(xy) < 2.94).all(axis=1)]
    cells = seen.spec.cell_of(inner_xy)
    assert known[cells[:, 1], cells[:, 0]].mean() > 0.99
    iy, ix = np.nonzero(known)
    centres = np.column_stack((seen.spec.center_of(np.stack((ix, iy), 1)), np.zeros(len(ix))))
    assert pose.inverse().apply(centres)[:, 2].max() <= 3.0
    behind = Pose("map", "camera", mount_pose(1.0, 25.0, yaw_deg=210, parent="map").matrix)
    away = frame_map(open_lawn, scene_map(open_lawn), CAMERA, behind, 0)
    assert away.spec.offset_in(scene_map(open_lawn).spec) is not None


def test_a_garden_of_many_triangles_takes_a_moment() -> None:
    rng = np.random.default_rng(0)
    n = 150_000  # leaves of 2 triangles
    centre = rng.uniform((-2.5, -2.5, 0.3), (2.5, 2.5, 5.0), (n, 1, 3))
    card = rng.normal(0, 0.03, (n, 4, 3))
    xyz = (centre + card).reshape(-1, 3)
    corner = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (np.arange(n)[:, None, None] * 4 + corner).reshape(-1, 3)
    normals = np.tile([0.0, 0, 1], (len(xyz), 1))
    leaves = mesh_of(xyz, normals, normals[:, :2], faces, Material(cutout=True))
    full = garden(thing(leaves), thing(leaves, 0.02))  # 600 k triangles
    start = time.process_time()
    made = scene_map(full)
    seconds = time.process_time() - start
    assert made.count(MapClass.OBSTACLE) > 0.6 * made.classes.size
    assert seconds < 4.0, "1 s where this was written"
