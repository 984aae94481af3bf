"""What the encodings of sensor_msgs/Image mean: how a pixel is stored, and how it becomes RGB.

The names are those of sensor_msgs/image_encodings, their meaning is that of cv_bridge: YUV by OpenCV's
conversions, 16-bit colour scaled to 8 bits, mosaics filled in bilinearly.
nv12 is nowhere declared, and common.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

ColorImage = NDArray[np.uint8]

GRAY = ("mono8", "8UC1")
DEPTH = ("16UC1", "mono16", "32FC1")
PLANAR = ("nv12", "nv21")
"""Brightness in full, then colour in half the rows: one and a half times as many rows as the image has."""

_BAYER = {"rggb": "BG", "bggr": "RG", "gbrg": "GR", "grbg": "GB"}
"""ROS names a mosaic by its first two rows, OpenCV by the second row from the second column on."""

_YUV = {
    "yuv422": "UYVY",
    "uyvy": "UYVY",
    "yuv422_yuy2": "YUY2",
    "yuyv": "YUY2",
    "nv12": "NV12",
    "nv21": "NV21",
}

STORED: dict[str, tuple[str, int]] = {
    **dict.fromkeys(("rgb8", "bgr8", "8UC3"), ("u1", 3)),
    **dict.fromkeys(("rgba8", "bgra8", "8UC4"), ("u1", 4)),
    **dict.fromkeys(("rgb16", "bgr16", "16UC3"), ("u2", 3)),
    **dict.fromkeys(("rgba16", "bgra16", "16UC4"), ("u2", 4)),
    **dict.fromkeys(("yuv422", "uyvy", "yuv422_yuy2", "yuyv"), ("u1", 2)),
    **dict.fromkeys(PLANAR, ("u1", 1)),
    **{f"bayer_{name}8": ("u1", 1) for name in _BAYER},
    **{f"bayer_{name}16": ("u2", 1) for name in _BAYER},
    **dict.fromkeys(GRAY, ("u1", 1)),
    "16UC1": ("u2", 1),
    "mono16": ("u2", 1),
    "32FC1": ("f4", 1),
}
"""Type of a number and numbers a pixel, of each encoding that is read."""

VIDEO = ("h264", "h.264", "x264", "h265", "h.265", "x265", "hevc", "av1", "vp8", "vp9", "mpeg4", "theora")
"""Words in the format of a CompressedImage that is a part of a video: it means nothing without the others."""


def is_video(form: str) -> bool:
    """Whether the format of a CompressedImage names a video codec."""
    return any(word in form.lower() for word in VIDEO)


def is_color(encoding: str) -> bool:
    """Whether an encoding can be shown as RGB, gray included."""
    return encoding in STORED and encoding not in DEPTH


def is_gray(code: str) -> bool:
    """Whether an encoding, or the format of a CompressedImage, has brightness alone."""
    return code.split(";")[0].strip() in GRAY or code.rstrip().endswith(
        ("compressed mono8", "compressed 8UC1")
    )


def unfit_size(encoding: str, pixels: NDArray[Any]) -> str | None:
    """What the size of an image should be for its colours to be found; None if it is."""
    rows, columns = pixels.shape[:2]
    if encoding in PLANAR and (rows % 3 or columns % 2):
        return "an even number of rows and columns"
    if encoding in _YUV and columns % 2:
        return "an even number of columns"
    if encoding.startswith("bayer_") and min(rows, columns) < 4:
        return "at least 4 rows and columns"
    return None


def to_rgb(encoding: str, pixels: NDArray[Any]) -> ColorImage:
    """(H, W, 3) uint8 RGB of pixels as they are stored.

    Args:
        encoding: one of `STORED` that is no depth.
        pixels: (H, W) or (H, W, channels); of `PLANAR` (3/2 H, W).
    """
    if encoding in GRAY:
        return np.ascontiguousarray(np.broadcast_to(pixels[..., None], (*pixels.shape, 3)))
    if encoding in _YUV:
        return _by_opencv(f"YUV2RGB_{_YUV[encoding]}")(pixels)
    if encoding.startswith("bayer_"):
        return _eight_bits(_by_opencv(f"Bayer{_BAYER[encoding[6:10]]}2RGB")(pixels))
    if encoding.startswith("rgb"):
        return _eight_bits(pixels[..., :3])
    return _eight_bits(pixels[..., 2::-1])  # without a colour name it is OpenCV's order


def _by_opencv(code: str) -> Callable[[NDArray[Any]], NDArray[Any]]:
    import cv2

    return lambda pixels: np.asarray(
        cv2.cvtColor(np.ascontiguousarray(pixels), getattr(cv2, f"COLOR_{code}"))
    )


def _eight_bits(pixels: NDArray[Any]) -> ColorImage:
    pixels = np.ascontiguousarray(pixels)
    if pixels.dtype == np.uint8:
        return pixels
    import cv2

    return np.asarray(cv2.convertScaleAbs(pixels, alpha=255 / 65535), np.uint8)
