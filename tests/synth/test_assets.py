"""The garden assets: every one whole, on the ground and as its index says; damage is one clear error."""

import hashlib
import io
import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.errors import InputError, MissingExtraError
from swardmap.synth import assets as assets_module
from swardmap.synth.asset_bundle import packed_normals, quantised, unpacked_normals, unquantised
from swardmap.synth.asset_entries import Source
from swardmap.synth.assets import Assets, open_assets
from swardmap.synth.model import Material, Mesh, Texture
from swardmap.synth.shapes import box, sphere
from tools.bake_assets.attribution import document
from tools.bake_assets.bundle import BundleWriter

FOLDER = Path(__file__).parents[2] / "garden_assets" / "swardmap_garden_assets"
SHIPPED = open_assets(FOLDER)
SOURCE = Source("thing", "somebody", "CC0-1.0", "package 1")
FREE = {"CC0-1.0", "CC-BY-3.0", "CC-BY-3.0-US", "MIT", "Apache-2.0 AND CC0-1.0"}


def corners(mesh: Mesh) -> np.ndarray:
    return mesh.xyz.astype(np.float64)[mesh.faces]


def volume_m3(meshes: tuple[Mesh, ...]) -> float:
    """Enclosed by closed meshes whose faces are counter-clockwise from outside (divergence theorem)."""
    triangles = np.concatenate([corners(mesh) for mesh in meshes])
    return float(np.linalg.det(triangles).sum() / 6)


def made(folder: Path, name: str = "a") -> Path:
    """A small bundle of its own."""
    rgba = np.random.default_rng(0).integers(0, 255, (16, 24, 4), np.uint8)
    bundle = BundleWriter()
    bundle.add_texture(f"{name}-skin", rgba, "skin", SOURCE)
    textured = Material((0.5, 1.0, 0.25), Texture(f"{name}-skin", rgba), True, 0.5, 0.25, 0.75)
    bundle.add_model(f"{name}-ball", [sphere(0.5, material=textured), box((1, 2, 0.5))], "ball", SOURCE)
    bundle.add_arrays(f"{name}-numbers", {"x": np.arange(6.0).reshape(2, 3), "i": np.arange(3)}, SOURCE)
    bundle.write(folder / f"{name}.zip")
    return folder


def rewritten(path: Path, changed: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path) as old:
        members = {name: old.read(name) for name in old.namelist()}
    with zipfile.ZipFile(path, "w") as new:
        for name, content in (members | changed).items():
            new.writestr(name, content)


def index_of(path: Path) -> dict[str, Any]:
    with zipfile.ZipFile(path) as bundle:
        index: dict[str, Any] = json.loads(bundle.read("index.json"))
    return index


@pytest.mark.parametrize("name", SHIPPED.names())
def test_a_shipped_model_is_whole_stands_on_the_ground_and_is_as_large_as_its_index_says(name: str) -> None:
    model, entry = SHIPPED.model(name), SHIPPED.entry(name)
    low, high = model.bounds_m()
    assert np.allclose(low, entry.low_m, atol=1e-3)
    assert np.allclose(high, entry.high_m, atol=1e-3)
    assert abs(low[2]) < 0.01
    assert 0.01 < max(entry.size_m) < 15
    assert entry.triangles == sum(len(mesh.faces) for mesh in model.meshes) < 20_000
    for mesh in model.meshes:
        assert np.isfinite(mesh.uv).all()
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)


SOLID = (
    "barrel",
    "crate",
    "dog",
    "cat",
    "horse",
    "soccer-ball",
    "rock1",
    "rock2",
    "stone-lantern-1",
    "fire-hydrant",
)


@pytest.mark.parametrize("name", SOLID)
def test_solid_models_are_turned_outward(name: str) -> None:
    model, entry = SHIPPED.model(name), SHIPPED.entry(name)
    assert 0.1 * np.prod(entry.size_m) < volume_m3(model.meshes) < np.prod(entry.size_m)


def test_normals_point_to_the_side_from_which_faces_run_counter_clockwise() -> None:
    against = total = 0
    for name in SHIPPED.names():
        for mesh in SHIPPED.model(name).meshes:
            if not mesh.material.translucency:  # leaves have the normals of their crown
                a, b, c = np.moveaxis(corners(mesh), 1, 0)
                faces = np.cross(b - a, c - a)
                mean = mesh.normals[mesh.faces].sum(axis=1)
                against += int(((faces * mean).sum(axis=1) < 0).sum())
                total += len(faces)
    assert total > 100_000
    assert against < 0.005 * total


@pytest.mark.parametrize(
    ("kind", "least"), [("tree", 12), ("shrub", 6), ("person", 25), ("hedge", 3), ("bench", 3)]
)
def test_there_is_enough_of_each_kind(kind: str, least: int) -> None:
    assert len(SHIPPED.names(kind)) >= least


def test_people_are_as_tall_as_people_and_have_a_pose() -> None:
    people = [SHIPPED.entry(name) for name in SHIPPED.names("person")]
    assert {"standing", "sitting", "lying"} <= {person.pose for person in people}
    assert all(1.5 < person.size_m[2] < 1.95 for person in people if person.pose == "standing")
    assert all(person.size_m[2] < 0.7 for person in people if person.pose == "lying")
    assert all(0.3 < person.seat_m < 0.55 for person in people if person.seat_m)


def test_leaves_are_a_natural_green() -> None:
    """Foliage reflects a few hundredths to some tenths, green most, blue least (no neon)."""
    for name in SHIPPED.names("tree"):
        if not name.startswith(("oak", "ash", "aspen", "pine")):
            continue  # grown ones only: others may be red or blue
        (leaves,) = (mesh for mesh in SHIPPED.model(name).meshes if mesh.material.translucency)
        assert leaves.material.texture is not None
        assert leaves.material.cutout
        rgba = leaves.material.texture.rgba
        solid = (rgba[rgba[..., 3] > 100][:, :3] / 255.0) ** 2.2
        r, g, b = solid.mean(axis=0) * leaves.material.color
        assert 0.02 < b < r < g < 0.25
        assert g < 2.2 * r


def test_ground_textures_are_seamless_and_say_how_far_they_reach() -> None:
    """Across the border neighbouring rows and columns differ no more than inside."""
    kinds = {"gravel", "paving", "brick", "dirt", "mulch", "sand", "concrete", "wood", "carpet",
             "leaf_litter", "plaster", "roof", "grass"}  # fmt: skip
    assert kinds <= {SHIPPED.texture_entry(name).kind for name in SHIPPED.texture_names()}
    for name in SHIPPED.texture_names():
        entry = SHIPPED.texture_entry(name)
        if entry.kind == "skin":
            continue
        rgb = SHIPPED.texture(name).rgba[..., :3].astype(float)
        assert max(rgb.shape[:2]) <= 512
        assert 0.1 < entry.tile_m[0] < 5
        for axis in (0, 1):
            steps = np.abs(np.diff(rgb, axis=axis)).mean(axis=(1 - axis, 2))
            seam = np.abs(np.take(rgb, 0, axis) - np.take(rgb, -1, axis)).mean()
            assert seam <= steps.max() * 1.25 + 2, name


def test_every_asset_is_attributed_and_free() -> None:
    text = (FOLDER / "ATTRIBUTION.md").read_text(encoding="utf-8")
    assert text == document(SHIPPED), "run: python -m tools.bake_assets.attribution " + str(FOLDER)
    for what, names in (("model", SHIPPED.names()), ("texture", SHIPPED.texture_names())):
        for name in names:
            entry = SHIPPED.entry(name) if what == "model" else SHIPPED.texture_entry(name)
            assert f"- {what} {name}: '{entry.source.title}' by {entry.source.author}, " in text
            assert entry.source.licence in FREE
            assert entry.source.author not in ("", "unknown")
    for name in SHIPPED.array_names():
        assert f"- arrays {name}: " in text
    assert set(re.findall(r"' by [^\n]*?, ([\w.-]+(?: AND [\w.-]+)?), from ", text)) <= FREE


def test_the_bundles_are_small_enough_for_the_repository() -> None:
    assert sum(path.stat().st_size for path in FOLDER.glob("*.zip")) < 30e6


def test_what_is_written_is_read(tmp_path: Path) -> None:
    assets = open_assets(made(tmp_path))
    ball, block = assets.model("a-ball").meshes
    truth = sphere(0.5)
    assert volume_m3((ball,)) == pytest.approx(volume_m3((truth,)), rel=1e-3)
    assert ball.uv.min() == pytest.approx(truth.uv.min(), abs=1e-4)
    assert volume_m3((block,)) == pytest.approx(1.0, rel=1e-3)
    material = ball.material
    assert (material.color, material.cutout) == ((0.5, 1.0, 0.25), True)
    assert (material.translucency, material.specular, material.roughness) == (0.5, 0.25, 0.75)
    assert material.texture is assets.texture("a-skin")
    assert material.texture.rgba.shape == (16, 24, 4)
    assert np.array_equal(assets.arrays("a-numbers")["x"], [[0, 1, 2], [3, 4, 5]])
    with pytest.raises(ValueError, match="read-only"):
        assets.arrays("a-numbers")["x"][0, 0] = 1
    assert assets.model("a-ball") is assets.model("a-ball")


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 1e3))
def test_positions_are_off_by_at_most_half_a_step_and_normals_by_one_degree(seed: int, size: float) -> None:
    values = np.random.default_rng(seed).normal(size=(50, 3))
    low, high = values.min(axis=0) * size, values.max(axis=0) * size
    back = unquantised(quantised(values * size, low, high), low, high)
    half_step = (high - low) / 65535 / 2
    assert (np.abs(back - values * size) <= half_step + 2e-7 * np.abs(values * size)).all()
    unit = values / np.linalg.norm(values, axis=1, keepdims=True)
    cosine = (unpacked_normals(packed_normals(unit)) * unit).sum(axis=1)
    assert (cosine > np.cos(np.deg2rad(1.0))).all()


def test_the_same_content_gives_the_same_bytes_and_digest(tmp_path: Path) -> None:
    first, second = tmp_path / "1", tmp_path / "2"
    for folder in (first, second):
        folder.mkdir()
        made(folder)
    assert (first / "a.zip").read_bytes() == (second / "a.zip").read_bytes()
    assert open_assets(first).digest == open_assets(second).digest != SHIPPED.digest


def test_opening_reads_only_the_index(tmp_path: Path) -> None:
    made(tmp_path)
    rewritten(tmp_path / "a.zip", {"models/a-ball.npz": b"no archive", "textures/a-skin.webp": b"no picture"})
    assets = open_assets(tmp_path)
    assert assets.names() == ("a-ball",)
    assert assets.entry("a-ball").size_m == pytest.approx((1, 2, 1))
    with pytest.raises(
        InputError, match=r"a-ball: expected a whole asset.*SHA-256.*install the garden assets again"
    ):
        assets.model("a-ball")


def test_a_member_whose_index_lies_along_is_still_one_clear_error(tmp_path: Path) -> None:
    """Content that fits its checksum but not its kind: pickles, broken pictures, foreign arrays."""
    buffer = io.BytesIO()
    np.savez(buffer, x=np.array([{}], dtype=object))
    for part, member, content in (
        ("models", "models/a-ball.npz", buffer.getvalue()),
        ("models", "models/a-ball.npz", b"PK"),
        ("textures", "textures/a-skin.webp", b"RIFF0000WEBP"),
        ("arrays", "arrays/a-numbers.npz", buffer.getvalue()),
    ):
        made(tmp_path)
        index = index_of(tmp_path / "a.zip")
        name = member.split("/")[1].rpartition(".")[0]
        index[part][name]["sha256"] = hashlib.sha256(content).hexdigest()
        rewritten(tmp_path / "a.zip", {"index.json": json.dumps(index).encode(), member: content})
        assets = open_assets(tmp_path)
        read = {"models": assets.model, "textures": assets.texture, "arrays": assets.arrays}[part]
        with pytest.raises(InputError, match=rf"a\.zip: {part}/{name}.*expected .*, got"):
            read(name)


@pytest.mark.parametrize("length", [0, 10, 200, 1500])
def test_a_truncated_bundle_is_one_clear_error(tmp_path: Path, length: int) -> None:
    path = made(tmp_path) / "a.zip"
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(InputError, match="expected a bundle of garden assets"):
        open_assets(tmp_path)


@pytest.mark.parametrize(
    "index",
    [
        b"", b"[]", b"{}", b"\xff", b"[" * 100_000,
        b'{"format": "something else"}',
        b'{"format": "swardmap-garden-assets/1", "models": {}, "textures": {}}',
        b'{"format": "swardmap-garden-assets/1", "models": {"../../x": {}}, "textures": {}, "arrays": {}}',
        b'{"format": "swardmap-garden-assets/1", "models": {"/x": {}}, "textures": {}, "arrays": {}}',
        b'{"format": "swardmap-garden-assets/1", "models": {"x": {"kind": 1}}, "textures": {}, "arrays": {}}',
    ],
)  # fmt: skip
def test_a_foreign_index_is_one_clear_error(tmp_path: Path, index: bytes) -> None:
    rewritten(made(tmp_path) / "a.zip", {"index.json": index})
    with pytest.raises(InputError, match="expected"):
        open_assets(tmp_path)


def test_an_array_that_unpacks_to_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swardmap.synth.asset_bundle.MAX_MEMBER_BYTES", 100_000)
    bundle = BundleWriter()
    bundle.add_arrays("large", {"x": np.zeros(20_000)}, SOURCE)
    bundle.write(tmp_path / "a.zip")
    with pytest.raises(InputError, match="at most 100000 bytes"):
        open_assets(tmp_path).arrays("large")


def test_two_bundles_may_not_have_the_same_name(tmp_path: Path) -> None:
    made(tmp_path)
    (tmp_path / "b.zip").write_bytes((tmp_path / "a.zip").read_bytes())
    with pytest.raises(InputError, match=r"a\.zip and in b\.zip"):
        open_assets(tmp_path)


def test_an_unknown_name_is_one_clear_error(tmp_path: Path) -> None:
    assets = open_assets(made(tmp_path))
    for read in (assets.model, assets.entry, assets.texture, assets.texture_entry, assets.arrays):
        with pytest.raises(InputError, match="got 'unicorn'"):
            read("unicorn")
    assert assets.names("unicorn") == ()


def test_missing_assets_are_one_clear_error_with_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(
        MissingExtraError, match=r"pip install the wheel swardmap_garden_assets .*\./garden_assets"
    ):
        open_assets(tmp_path)
    monkeypatch.delenv(assets_module.VARIABLE, raising=False)
    monkeypatch.setattr(assets_module, "MODULE", "no_such_module_of_assets")
    with pytest.raises(
        MissingExtraError, match=r"pip install the wheel swardmap_garden_assets .*\./garden_assets"
    ):
        open_assets()


def test_the_environment_names_the_folder_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(assets_module.VARIABLE, str(made(tmp_path)))
    assert open_assets().names() == ("a-ball",)


def test_a_checkout_finds_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(assets_module.VARIABLE, raising=False)
    found: Assets = open_assets()
    assert found.names("bench")
