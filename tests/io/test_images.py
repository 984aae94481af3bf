"""Images: what OpenCV writes is read; half an image is an error, not half a map."""

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.errors import InputError
from swardmap.io.images import color_of, decode, encode_jpeg, encode_png, read_color, read_depth, read_mask

RNG = np.random.default_rng(0)
RGB = RNG.integers(0, 256, (23, 31, 3)).astype(np.uint8)
DEPTH = RNG.integers(0, 65536, (23, 31)).astype(np.uint16)
MASK = RNG.choice([0, 1, 2, 255], (23, 31)).astype(np.uint8)


def test_what_opencv_writes_is_read(tmp_path: Path) -> None:
    for name, image in (("rgb.png", RGB[..., ::-1]), ("depth.png", DEPTH), ("mask.png", MASK)):
        cv2.imwrite(str(tmp_path / name), image)
    np.testing.assert_array_equal(read_color(tmp_path / "rgb.png"), RGB)
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.png"), DEPTH)
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png"), MASK)


def test_what_is_written_here_is_read_by_opencv() -> None:
    back = cv2.imdecode(np.frombuffer(encode_png(RGB), np.uint8), cv2.IMREAD_COLOR)
    assert back is not None
    np.testing.assert_array_equal(back[..., ::-1], RGB)
    smooth = cv2.GaussianBlur(RGB, (9, 9), 4)
    jpeg = color_of(decode(encode_jpeg(np.asarray(smooth, np.uint8)), "x"), "x")
    assert np.abs(jpeg.astype(int) - smooth).mean() < 4


def test_grey_and_transparent_images_become_rgb(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "grey.png"), MASK)
    assert read_color(tmp_path / "grey.png").shape == (23, 31, 3)
    cv2.imwrite(str(tmp_path / "alpha.png"), np.dstack([RGB[..., ::-1], MASK]))
    np.testing.assert_array_equal(read_color(tmp_path / "alpha.png"), RGB)


def test_depth_as_numpy_files(tmp_path: Path) -> None:
    for dtype in (np.uint16, np.float32):
        np.save(tmp_path / "d.npy", DEPTH.astype(dtype))
        np.testing.assert_array_equal(read_depth(tmp_path / "d.npy"), DEPTH.astype(dtype))
    np.save(tmp_path / "d.npy", DEPTH.astype(np.float64))
    with pytest.raises(InputError, match="got float64"):
        read_depth(tmp_path / "d.npy")
    np.save(tmp_path / "d.npy", np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="NumPy array"):
        read_depth(tmp_path / "d.npy")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("encode", [encode_png, encode_jpeg])
def test_truncated_images_are_refused(tmp_path: Path, share: float, encode: object) -> None:
    content = encode(RGB)  # type: ignore[operator]
    (tmp_path / "x.png").write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match="truncated"):
        read_color(tmp_path / "x.png")


def test_wrong_kinds_are_refused(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "rgb.png"), RGB)
    cv2.imwrite(str(tmp_path / "depth.png"), DEPTH)
    for read, name in (
        (read_depth, "rgb.png"),
        (read_mask, "rgb.png"),
        (read_mask, "depth.png"),
        (read_color, "depth.png"),
    ):
        with pytest.raises(InputError, match="expected"):
            read(tmp_path / name)
    with pytest.raises(InputError, match="cannot read"):
        read_color(tmp_path / "missing.png")


@given(st.binary(max_size=300), st.sampled_from([b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"BM", b"P5\n"]))
def test_random_bytes_are_one_error_or_an_image(tail: bytes, head: bytes) -> None:
    try:
        image = decode(head + tail, "x")
    except InputError:
        return
    assert image.ndim in (2, 3)


@pytest.mark.parametrize("suffix", [".tif", ".tiff"])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_depth_as_tiff(suffix: str, dtype: Any, tmp_path: Path) -> None:
    file = tmp_path / f"d{suffix}"
    for size in (40, 400):
        depth = (np.random.default_rng(0).random((size, size)) * 1000).astype(dtype)
        for pressed in (1, 5):  # none, LZW
            cv2.imwrite(str(file), depth, [cv2.IMWRITE_TIFF_COMPRESSION, pressed])
            np.testing.assert_array_equal(read_depth(file), depth)
            whole = file.read_bytes()
            for share in (0.1, 0.5, 0.9, 0.999):
                file.write_bytes(whole[: int(share * len(whole))])
                with pytest.raises(InputError, match=re.escape(str(file))):
                    read_depth(file)
    cv2.imwrite(str(file), np.zeros((4, 4), np.uint8))
    with pytest.raises(InputError, match="got uint8"):
        read_depth(file)
