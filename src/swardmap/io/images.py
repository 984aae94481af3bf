"""Colour, depth and mask images from files, checked so that half an image never passes as a whole one."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.door import parse_npy, reading
from swardmap.io.files import read_bytes
from swardmap.io.image_headers import check_image

MAX_FILE_BYTES = 512 * 2**20
DEPTH_SUFFIXES = (".png", ".tif", ".tiff", ".npy")

DepthImage = NDArray[np.uint16] | NDArray[np.float32]


def read_color(path: Path) -> NDArray[np.uint8]:
    """A colour image as (H, W, 3) uint8 RGB; grey images are repeated, alpha is dropped.

    Raises:
        InputError: if it is missing, truncated, or not an 8-bit image.
    """
    return color_of(decode(read_bytes(path, MAX_FILE_BYTES), str(path)), str(path))


def read_depth(path: Path) -> DepthImage:
    """A depth image: 16-bit PNG or TIFF, TIFF of float32, or .npy of uint16 or float32; (H, W).

    Eight bits are refused: they are a picture of depth, not depth.

    Raises:
        InputError: if it is missing, truncated, or of another kind.
    """
    content = read_bytes(path, MAX_FILE_BYTES)
    depth = parse_npy(content, path) if path.suffix == ".npy" else decode(content, str(path))
    return depth_of(depth, str(path))


def read_mask(path: Path) -> NDArray[np.uint8]:
    """A mask of class ids: 8-bit single-channel image, (H, W) uint8.

    Raises:
        InputError: if it is missing, truncated, or of another kind.
    """
    mask = decode(read_bytes(path, MAX_FILE_BYTES), str(path))
    if mask.ndim != 2 or mask.dtype != np.uint8:
        raise InputError(f"{path}: expected an 8-bit single-channel mask of class ids, got {_kind(mask)}")
    return mask


def color_of(image: NDArray[Any], name: str) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB of an image as OpenCV decodes it (grey, BGR or BGRA)."""
    if image.dtype != np.uint8:
        raise InputError(f"{name}: expected an 8-bit colour image, got {_kind(image)}")
    if image.ndim == 2:
        return np.repeat(image[..., None], 3, axis=2)
    return np.ascontiguousarray(image[..., 2::-1])


def depth_of(image: NDArray[Any], name: str) -> DepthImage:
    """Check that an array is a depth image: (H, W) uint16 or float32, and not empty."""
    if image.ndim != 2 or image.dtype not in (np.dtype(np.uint16), np.dtype(np.float32)) or image.size == 0:
        raise InputError(
            f"{name}: expected a depth image, uint16 or float32 of one channel, got {_kind(image)}"
        )
    return np.ascontiguousarray(image)


def decode(content: bytes, name: str, flags: int | None = None) -> NDArray[Any]:
    """Decode an image file as it is: (H, W) or (H, W, 3 or 4) in OpenCV's order, 8 or 16 bits.

    Args:
        content: of the file or message.
        name: for messages.
        flags: of cv2.imdecode; None = as the file is, and as it lies, however a camera was held.

    Raises:
        InputError: if it is truncated, damaged, too large, or no image of a known format.
    """
    import cv2

    check_image(content, name)
    if flags is None:
        flags = cv2.IMREAD_UNCHANGED | getattr(cv2, "IMREAD_IGNORE_ORIENTATION", 0)
    with reading(name, "an image"):
        image = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    if image is None:
        raise InputError(f"{name}: cannot be decoded as an image ({len(content)} bytes)")
    return np.asarray(image)


def encode_png(image: NDArray[Any]) -> bytes:
    """PNG of a mask (H, W) uint8, a depth image (H, W) uint16 or an RGB image (H, W, 3) uint8."""
    import cv2

    bgr = image[..., ::-1] if image.ndim == 3 else image
    _, encoded = cv2.imencode(".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, 3])
    return bytes(encoded)


def encode_jpeg(rgb: NDArray[np.uint8], quality: int = 95) -> bytes:
    """JPEG of an RGB image (H, W, 3) uint8."""
    import cv2

    bgr = np.ascontiguousarray(rgb[..., ::-1])
    _, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return bytes(encoded)


def _kind(image: NDArray[Any]) -> str:
    return f"{image.dtype} of shape {image.shape}"
