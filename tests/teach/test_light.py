"""Gardens in the light of a drive: lawns of its colour, the truth as it was."""

from pathlib import Path

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.io.files import write_bytes
from swardmap.io.images import encode_png, read_color, read_mask
from swardmap.labels import GRASS, OTHER, VOID_ID
from swardmap.teach.light import FEWEST_PIXELS, MOST_GAIN, driven_colours, lit, lit_frames, write_lit
from swardmap.teach.safety import REPLAY, safety_frames

BLUE = np.array([[0.02, 0.09, 0.10]])


def linear(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    """OpenCV's XYZ of D65 is linear in linear sRGB: an oracle for the curve."""
    xyz = cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)  # of which L and a, b give XYZ
    f_y = (xyz[..., 0] + 16) / 116
    f = np.stack([f_y + xyz[..., 1] / 500, f_y, f_y - xyz[..., 2] / 200], -1)
    t = np.where(f > 6 / 29, f**3, 3 * (6 / 29) ** 2 * (f - 4 / 29)) * np.array([0.950456, 1.0, 1.088754])
    to_rgb = np.linalg.inv(
        np.array(
            [[0.412453, 0.35758, 0.180423], [0.212671, 0.71516, 0.072169], [0.019334, 0.119193, 0.950227]]
        )
    )
    return np.asarray(t @ to_rgb.T)


def garden(shade: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    rng = np.random.default_rng(3)
    rgb = np.clip(rng.normal((90, 130, 60), 8, (60, 80, 3)) - shade, 0, 255).astype(np.uint8)
    lawn = np.zeros((60, 80), np.bool_)
    lawn[20:] = True
    rgb[:20] = (150, 110, 90)
    return rgb, lawn


def test_the_lawn_gets_the_wanted_colour_and_the_rest_the_same_light() -> None:
    rgb, lawn = garden()
    (out,) = lit([(rgb, lawn)], BLUE)
    np.testing.assert_allclose(linear(out)[lawn].mean(0), BLUE[0], atol=0.003)
    gains = linear(out)[lawn].mean(0) / linear(rgb)[lawn].mean(0)
    np.testing.assert_allclose(linear(out)[~lawn].mean(0), gains * linear(rgb)[~lawn].mean(0), atol=0.004)


@given(red=st.floats(0.01, 0.6), green=st.floats(0.01, 0.6), blue=st.floats(0.01, 0.6))
def test_its_own_light_changes_nothing_and_gains_are_limited(red: float, green: float, blue: float) -> None:
    rgb, lawn = garden()
    own = linear(rgb)[lawn].mean(0)
    (same,) = lit([(rgb, lawn)], own[None])
    assert np.abs(same.astype(int) - rgb).max() <= 1
    (other,) = lit([(rgb, lawn)], np.array([[red, green, blue]]))
    seen = (other > 5) & (other < 250) & (rgb > 5)
    ratio = (linear(other) / np.maximum(linear(rgb), 1e-6))[seen]
    assert ratio.min(initial=1) > 0.8 / MOST_GAIN
    assert ratio.max(initial=1) < 1.2 * MOST_GAIN


def test_colours_come_in_turn_and_a_view_without_lawn_is_lit_as_the_others() -> None:
    bright, dark = garden(), garden(30)
    bare = (bright[0], np.zeros_like(bright[1]))
    colours = np.array([BLUE[0], [0.2, 0.15, 0.05]])
    one, two, three = lit([bright, dark, bare], colours)
    np.testing.assert_allclose(linear(one)[bright[1]].mean(0), colours[0], atol=0.003)
    np.testing.assert_allclose(linear(two)[dark[1]].mean(0), colours[1], atol=0.006)
    assert linear(three).mean(0).mean(0)[0] < linear(bright[0]).mean(0).mean(0)[0]
    assert list(lit([bare], colours)) == []


def write_frame(folder: Path, name: str, rgb: NDArray[np.uint8], labels: NDArray[np.uint8]) -> None:
    for part, image in (("images", rgb), ("labels", labels)):
        (folder / part).mkdir(parents=True, exist_ok=True)
        suffix = "png" if part == "labels" else "jpg"
        write_bytes(folder / part / f"{name}.{suffix}", encode_png(image), durable=False)


def test_colours_of_the_driven_ground_alone(tmp_path: Path) -> None:
    rgb, lawn = garden()
    write_frame(tmp_path, "a", rgb, np.where(lawn, GRASS.id, OTHER.id).astype(np.uint8))
    write_frame(tmp_path, "b", rgb, np.full(lawn.shape, VOID_ID, np.uint8))
    np.testing.assert_allclose(driven_colours(tmp_path), linear(rgb)[lawn].mean(0)[None], atol=0.002)
    (tmp_path / "none" / "images").mkdir(parents=True)
    assert driven_colours(tmp_path / "none").shape == (0, 3)


def test_written_gardens_keep_their_names_and_labels(tmp_path: Path) -> None:
    for name in ("b", "a"):
        rgb, lawn = garden()
        write_frame(tmp_path / "in", name, rgb, lawn.astype(np.uint8))
    write_lit(tmp_path / "in", tmp_path / "out", BLUE)
    names = [p.name for p in sorted((tmp_path / "out" / "images").iterdir())]
    assert names == ["a.jpg", "b.jpg"]
    lawn = read_mask(tmp_path / "out" / "labels" / "a.png") == 1
    assert (lawn == garden()[1]).all()
    np.testing.assert_allclose(
        linear(read_color(tmp_path / "out" / "images" / "a.jpg"))[lawn].mean(0), BLUE[0], atol=0.01
    )


def test_the_gate_has_its_gardens_in_that_light() -> None:
    frames = [frame for frame, _ in zip(safety_frames(), range(6), strict=False)]
    found = list(lit_frames(frames, BLUE))
    assert [f.garden for f in found] == [f.garden for f in frames]
    for before, after in zip(frames, found, strict=True):
        assert after.labels is before.labels
        assert after.instances is before.instances
        lawn = after.labels == GRASS.id
        red, _, blue = after.rgb[lawn].mean(0)
        assert blue > red
    assert list(lit_frames(frames, np.zeros((0, 3)))) == []


def test_the_replayed_gardens_show_enough_lawn() -> None:
    labels = sorted((REPLAY / "labels").iterdir())
    assert sum((read_mask(p) == GRASS.id).sum() >= FEWEST_PIXELS for p in labels) >= 100
