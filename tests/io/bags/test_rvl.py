"""RVL against an encoder written here, by the letter of the published algorithm."""

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.bags.ros_messages import depth_from_compressed
from swardmap.io.bags.rvl import decode_rvl


def encode_rvl(image: NDArray[np.uint16]) -> bytes:
    """Wilson's CompressRVL, number by number and nibble by nibble, with the head of the ROS plugin."""
    nibbles: list[int] = []

    def emit(value: int) -> None:
        while True:
            low, value = value & 7, value >> 3
            nibbles.append(low | 8 if value else low)
            if not value:
                return

    pixels, at, previous = image.reshape(-1).tolist(), 0, 0
    while at < len(pixels):
        start = at
        while at < len(pixels) and pixels[at] == 0:
            at += 1
        emit(at - start)
        start = at
        while at < len(pixels) and pixels[at] != 0:
            at += 1
        emit(at - start)
        for pixel in pixels[start:at]:
            delta = pixel - previous
            emit(2 * delta if delta >= 0 else -2 * delta - 1)
            previous = pixel
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{n:x}" for n in nibbles[i : i + 8]), 16) for i in range(0, len(nibbles), 8)]
    return struct.pack("<II", image.shape[1], image.shape[0]) + struct.pack(f"<{len(words)}I", *words)


images = hnp.arrays(
    np.uint16,
    hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=12),
    elements=st.one_of(st.just(0), st.integers(0, 65535), st.integers(900, 1100)),
)


@given(images)
def test_what_was_encoded_comes_back(image: NDArray[np.uint16]) -> None:
    np.testing.assert_array_equal(decode_rvl(encode_rvl(image)), image)


def test_a_depth_image_comes_back() -> None:
    v, u = np.mgrid[:240, :320]
    depth = (800 + 5 * v + np.random.default_rng(0).integers(0, 20, v.shape)).astype(np.uint16)
    depth[(u - 100) ** 2 + (v - 90) ** 2 < 900] = 0
    data = encode_rvl(depth)
    assert len(data) < depth.nbytes
    np.testing.assert_array_equal(decode_rvl(data), depth)


class Message:
    def __init__(self, form: str, data: bytes) -> None:
        self.format, self.data = form, np.frombuffer(data, np.uint8)


@pytest.mark.parametrize("form", ["16UC1; compressedDepth rvl", "16UC1; compressedDepth RVL"])
def test_compressed_depth_of_16_bits(form: str) -> None:
    depth = np.arange(600, dtype=np.uint16).reshape(20, 30)
    message: Any = Message(form, struct.pack("<iff", 0, 0, 0) + encode_rvl(depth))
    np.testing.assert_array_equal(depth_from_compressed(message), depth)


def test_compressed_depth_of_floats() -> None:
    # as compressed_depth_image_transport quantises: depth_quantization 100, depth_max 10
    metres = np.linspace(0.5, 9.5, 600, dtype=np.float32).reshape(20, 30)
    a = 100.0 * 101.0
    b = 1.0 - a / 10.0
    numbers = (a / metres + b).astype(np.uint16)
    message: Any = Message("32FC1; compressedDepth rvl", struct.pack("<iff", 0, a, b) + encode_rvl(numbers))
    np.testing.assert_allclose(depth_from_compressed(message), metres, rtol=0.012)


@given(data=st.binary(max_size=80))
def test_random_bytes_are_refused_or_fill_an_image(data: bytes) -> None:
    try:
        image = decode_rvl(data)
    except InputError:
        return
    assert image.size == np.prod(np.frombuffer(data, "<u4", 2).astype(np.int64))


def test_images_that_end_early_or_claim_too_much() -> None:
    data = encode_rvl(np.full((8, 8), 1000, np.uint16))
    for wrong in (data[:-4], data[:8], data[:5], struct.pack("<II", 2**31, 2**31) + data[8:]):
        with pytest.raises(InputError, match="RVL depth image"):
            decode_rvl(wrong)
