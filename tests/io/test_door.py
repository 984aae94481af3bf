"""Nothing that comes in from outside takes the reader by surprise: not its size, its shape or its faults."""

import io
import json
import os
import struct
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.errors import ConfigError, InputError, ModelError
from swardmap.io.door import open_archive, parse_json, parse_npy, parse_npz, parse_yaml, read_yaml, reading
from swardmap.io.files import read_bytes
from swardmap.io.image_headers import check_image
from swardmap.io.images import decode, read_depth
from tests.io.memory import memory_below

IMAGE = np.random.default_rng(0).integers(0, 255, (24, 40, 3), np.uint8)


def encoded(suffix: str, image: np.ndarray[Any, Any] = IMAGE) -> bytes:
    return bytes(cv2.imencode(suffix, image)[1])


def test_whatever_a_parser_raises_is_one_line_with_the_name() -> None:
    class OddError(Exception):
        pass

    undecoded = UnicodeDecodeError("utf-8", b"\xff", 0, 1, "bad")
    errors = (OddError("a\nb\t" + "x" * 5000), KeyError("k"), RecursionError(), MemoryError(),
              OSError(2, "no"), ConfigError("no"), ZeroDivisionError(), undecoded)  # fmt: skip
    for error in errors:
        with pytest.raises(InputError, match=r"a\.yaml") as raised, reading("a.yaml"):
            raise error
        assert len(str(raised.value)) < 400
        assert "\n" not in str(raised.value)
    with pytest.raises(KeyboardInterrupt), reading("a.yaml"):
        raise KeyboardInterrupt


def test_only_regular_files_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path):
        with pytest.raises(InputError, match="regular file"):
            read_bytes(path)
    with pytest.raises(InputError, match="expected at most 100 bytes"):
        read_bytes("/proc/self/smaps", 100)  # tells a size of 0


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tiff", ".webp", ".ppm"])
@pytest.mark.parametrize("shape", [(24, 40, 3), (24, 40)])
def test_every_known_format_is_decoded_up_to_the_limit(suffix: str, shape: tuple[int, ...]) -> None:
    suffix = ".pgm" if suffix == ".ppm" and len(shape) == 2 else suffix
    content = encoded(suffix, IMAGE if len(shape) == 3 else IMAGE[..., 0])
    assert decode(content, "x").shape[:2] == (24, 40)
    with pytest.raises(InputError, match="expected an image of at most 959 pixels, got 40 x 24"):
        check_image(content, "x", max_pixels=959)
    for end in (0, 1, 3, 9, 17, 25, 40):
        with pytest.raises(InputError):
            decode(content[:end], "x")


def test_sixteen_bits_and_opacity_count() -> None:
    for image in (np.zeros((3, 5), np.uint16), np.zeros((3, 5, 4), np.uint8), np.zeros((3, 5, 3), np.uint16)):
        assert decode(encoded(".png", image), "x").dtype == image.dtype


@pytest.mark.timeout(20)
def test_one_damaged_length_byte_of_a_png_costs_nothing() -> None:
    content = bytearray(encoded(".png"))
    for at in range(8, len(content)):
        if content[at + 4 : at + 8] == b"IDAT":
            break
    content[at] = 0xF6  # a chunk of 4.1 GB
    with pytest.raises(InputError, match="truncated or damaged"), memory_below(10**6):
        decode(bytes(content), "x")


def test_a_png_that_claims_to_be_huge_is_refused_before_it_is_decoded() -> None:
    head = struct.pack(">IIBBBBB", 2**30, 2**30, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", 13) + b"IHDR" + head + struct.pack(">I", zlib.crc32(b"IHDR" + head))
    end = b"\0\0\0\0IEND" + struct.pack(">I", zlib.crc32(b"IEND"))
    with pytest.raises(InputError, match="1073741824 x 1073741824"):
        decode(b"\x89PNG\r\n\x1a\n" + chunk + end, "x")


def twice_png(image: NDArray[np.uint8]) -> bytes:
    """A second header behind the pixels: of one pixel, which is what the last header says of the image."""
    content = encoded(".png", image)
    head = b"IHDR" + struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", 13) + head + struct.pack(">I", zlib.crc32(head))
    return content[:-12] + chunk + content[-12:]


def twice_tiff(image: NDArray[np.uint8]) -> bytes:
    """The width said twice; libtiff takes the first."""
    content = bytearray(encoded(".tiff", image))
    order = "<" if content[:2] == b"II" else ">"
    (at,) = struct.unpack_from(order + "I", content, 4)
    (count,) = struct.unpack_from(order + "H", content, at)
    entries = [bytes(content[at + 2 + 12 * k : at + 14 + 12 * k]) for k in range(count)]
    width = next(e for e in entries if struct.unpack_from(order + "H", e)[0] == 256)
    entries.insert(entries.index(width) + 1, width[:8] + struct.pack(order + "I", 1))
    struct.pack_into(order + "I", content, 4, len(content))
    return bytes(content) + struct.pack(order + "H", count + 1) + b"".join(entries) + bytes(4)


def commented_pgm(image: NDArray[np.uint8]) -> bytes:
    """OpenCV ends a comment at a carriage return; whoever reads on to the end of the line sees 1 x 1."""
    height, width = image.shape[:2]
    return f"P5 #\r{width} {height} 255 #\n1 1\n".encode() + image[..., 0].tobytes()


@pytest.mark.parametrize("lie", [twice_png, twice_tiff, commented_pgm])
def test_no_second_size_hides_the_one_that_is_decoded(lie: Callable[[NDArray[np.uint8]], bytes]) -> None:
    with pytest.raises(InputError, match=r"damaged|at most 900 pixels, got 40 x 24"):
        check_image(lie(IMAGE), "x", max_pixels=900)


@pytest.mark.parametrize("padding", [bytes(5000), b"\x5a\xff" * 2500])
def test_jpegs_that_cameras_pad_are_whole(padding: bytes) -> None:
    content = encoded(".jpg")
    assert decode(content + padding, "x").shape == IMAGE.shape
    with pytest.raises(InputError, match="truncated"):
        decode(content[: len(content) // 2] + padding, "x")


def test_the_end_of_a_thumbnail_is_no_end() -> None:
    content = encoded(".jpg")
    thumbnail = b"\xff\xe1" + struct.pack(">H", 2 + 400) + content[:398] + b"\xff\xd9"
    whole = content[:2] + thumbnail + content[2:]
    assert decode(whole, "x").shape == IMAGE.shape
    with pytest.raises(InputError, match="truncated"):
        check_image(whole[: 2 + len(thumbnail) + len(content) // 2], "x")


@given(
    st.integers(0, 2**31),
    st.binary(min_size=1, max_size=4),
    st.sampled_from([".png", ".jpg", ".bmp", ".tiff"]),
)
def test_no_damage_takes_the_decoder_by_surprise(at: int, damage: bytes, suffix: str) -> None:
    content = bytearray(encoded(suffix))
    at %= len(content)
    content[at : at + len(damage)] = damage
    try:
        assert decode(bytes(content), "x").size < 1e8
    except InputError:
        return


SHAPE = {"frames": int, "name?": str, "parts": [{"index": int, "score?": float | None}]}
GOOD = {"frames": 3, "parts": [{"index": 0, "score": None}, {"index": 1, "score": 2, "more": []}]}


def test_json_is_of_the_shape_that_is_expected() -> None:
    assert parse_json(json.dumps(GOOD), "x", SHAPE) == GOOD
    assert parse_json(b"\xef\xbb\xbf[1]", "x", [int]) == [1]


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "{}", '{"frames": 1e12, "parts": []}', '{"frames": Infinity, "parts": []}',
     '{"frames": true, "parts": []}', '{"frames": 1, "parts": [3]}', '{"frames": 1, "parts": [{}]}',
     '{"frames": 1, "parts": [{"index": 1, "score": "x"}]}',
     '{"frames": 1, "parts": [{"index": 1, "score": 1e999}]}', "[" * 100_000,
     '{"frames": ' + "9" * 5000 + ', "parts": []}',
     '{"frames": 1, "name": "' + "\\n" * 3000 + '", "parts": 7}', "\ud800"],
)  # fmt: skip
def test_json_of_another_shape_is_one_line(text: str) -> None:
    with pytest.raises(InputError, match=r"run\.json") as raised:
        parse_json(text.encode("utf-8", "surrogatepass"), "run.json", SHAPE)
    assert len(str(raised.value)) < 300
    assert "\n" not in str(raised.value)


def npy(array: np.ndarray[Any, Any]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


@given(
    st.sampled_from(["<u2", ">f4", "|u1", "<i8", "|b1"]),
    st.lists(st.integers(0, 4), max_size=3),
    st.booleans(),
)
def test_arrays_are_what_numpy_reads(kind: str, shape: list[int], fortran: bool) -> None:
    array = np.arange(np.prod(shape, dtype=int)).astype(kind).reshape(shape, order="F" if fortran else "C")
    found = parse_npy(npy(array), "x")
    np.testing.assert_array_equal(found, array)
    assert (found.dtype, found.shape) == (array.dtype, array.shape)


def npy_of(header: str) -> bytes:
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(header)) + header.encode() + bytes(24)


@pytest.mark.parametrize(
    "content",
    [b"", b"hello", npy_of("{'descr': '<f4', 'shape': (2,3"), npy_of("-" * 2600 + "1"), npy(np.zeros(9))[:-1],
     npy_of("{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 1000000000000)}"),
     npy_of("{'descr': '|O', 'fortran_order': False, 'shape': (1,)}"),
     npy_of("{'descr': '<f4', 'fortran_order': False, 'shape': (-1, -6)}"),
     npy_of("{'descr': '|V0', 'fortran_order': False, 'shape': (99999999999,)}")],
)  # fmt: skip
def test_arrays_that_are_none_are_one_line(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.npy"):
        read_depth(tmp_path / "a.npy")


@pytest.mark.timeout(20)
@pytest.mark.parametrize("order", ["<", ">"])
def test_text_of_letters_that_are_none_is_refused(order: str) -> None:
    good = io.BytesIO()
    np.save(good, np.array("free_limit").astype(f"{order}U10"))
    assert str(parse_npy(good.getvalue(), "x.npy")) == "free_limit"
    bad = good.getvalue()[:-40] + b"\xff" * 40
    with pytest.raises(InputError, match=r"x\.npy: .*letters that are none"):
        parse_npy(bad, "x.npy")


def test_an_archive_that_unpacks_to_gigabytes_is_refused_unread() -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("a.npy", "w") as member:
        for _ in range(64):
            member.write(bytes(2**20))
    started = time.monotonic()
    with pytest.raises(InputError, match="at most 1000000 bytes unpacked, got 67108864"):
        open_archive(buffer.getvalue(), "bomb.npz", 1_000_000)
    assert time.monotonic() - started < 1


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_a_member_that_says_it_is_small_unpacks_no_farther_than_it_says(method: int) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        archive.writestr("a.npy", bytes(2**27))
    lying = buffer.getvalue().replace(struct.pack("<I", 2**27), struct.pack("<I", 1000))
    with pytest.raises(InputError, match=r"bomb\.npz"), memory_below(2**27):
        open_archive(lying, "bomb.npz", 1_000_000, lzma=True)


@pytest.mark.parametrize("method", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_archives_are_packed_as_numpy_packs_them(method: int) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        archive.writestr("a.npy", npy(np.zeros(3)))
    with pytest.raises(InputError, match="packed in another way"):
        parse_npz(buffer.getvalue(), "x.npz")
    if method == zipfile.ZIP_LZMA:  # as garden assets are, whose index says the digest of each
        assert parse_npz(buffer.getvalue(), "x.npz", lzma=True)["a"].tolist() == [0, 0, 0]
    good = io.BytesIO()
    np.savez_compressed(good, a=np.arange(3), b=np.array("text"))
    found = parse_npz(good.getvalue(), "x.npz")
    assert found["a"].tolist() == [0, 1, 2]
    assert str(found["b"]) == "text"


@pytest.mark.parametrize(
    "text",
    ["a: 1\nb: 2\na: 3", "x:\n- {c: 1}\n- b: {c: 1, d: 2, c: 1}", "a: &k {b: 1}\n? b\n: 1\nb: *k"],
)
def test_a_key_said_twice_is_refused_with_both_lines(text: str) -> None:
    with pytest.raises(InputError, match=r"expected each key once, got '[abc]' in lines \d and \d; remove"):
        parse_yaml(text, "settings.yaml")


def test_the_same_key_in_two_places_or_as_number_and_text_is_no_repetition() -> None:
    text = "a: &k {b: 1}\nc: {b: 2}\nd: [*k, *k]\n1: x\n'1': y"
    assert parse_yaml(text, "x") == {"a": {"b": 1}, "c": {"b": 2}, "d": [{"b": 1}] * 2, 1: "x", "1": "y"}


def test_another_kind_of_error_and_what_to_do_go_through_the_door() -> None:
    kinds = (
        ValueError("v"),
        OSError(5, "io"),
        KeyError("k"),
        InputError("i"),
        RecursionError(),
        MemoryError(),
    )
    for error in kinds:
        with (
            pytest.raises(ModelError, match=r"net\.onnx.*; export it again$"),
            reading("net.onnx", "a network", ModelError, "export it again"),
        ):
            raise error


def test_yaml_through_the_door_is_an_input_error(tmp_path: Path) -> None:
    assert parse_yaml("a: [1, 2.5, x]", "x") == {"a": [1, 2.5, "x"]}
    for text in ("a: !!bool x", "[" * 3000, "a: &a [*a]"):
        (tmp_path / "a.yaml").write_text(text)
        with pytest.raises(InputError, match=r"a\.yaml"):
            read_yaml(tmp_path / "a.yaml")
