"""ROS messages to arrays, by attribute access only: those of `rosbags` and of `rclpy` alike.

Nothing of ROS is imported. The other direction, arrays to messages, is `ros_fields`.
"""

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.io.bags.encodings import (
    DEPTH,
    PLANAR,
    STORED,
    ColorImage,
    is_color,
    is_video,
    to_rgb,
    unfit_size,
)
from swardmap.io.bags.rvl import decode_rvl
from swardmap.io.image_headers import JPEG_START
from swardmap.io.images import decode

DepthImage = NDArray[np.uint16] | NDArray[np.float32]

VIDEO_REMEDY = (
    "a video stream means nothing picture by picture: record the raw or JPEG topic, or turn the recording "
    "into one with `ros2 run image_transport republish`"
)

_DEPTH_HEADER = struct.Struct("<iff")
"""What compressed_depth_image_transport writes before the PNG: an enum and two quantisation parameters."""

_PNG = b"\x89PNG\r\n\x1a\n"


def stamp_ns(stamp: Any) -> int:
    """Integer nanoseconds of a builtin_interfaces/Time (ROS 1: `secs`, `nsecs`)."""
    seconds = stamp.sec if hasattr(stamp, "sec") else stamp.secs
    nanoseconds = stamp.nanosec if hasattr(stamp, "nanosec") else stamp.nsecs
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


def image_array(message: Any) -> NDArray[Any]:
    """Pixels of a sensor_msgs/Image as they are stored; `step` and `is_bigendian` are honoured.

    Returns:
        (H, W) or (H, W, channels), a view of the message where possible.

    Raises:
        InputError: for an encoding that is not supported, or data of another size than said.
    """
    encoding, height, width = message.encoding, message.height, message.width
    if encoding not in STORED:
        raise InputError(f"image encoding '{encoding}' is not supported; expected one of {', '.join(STORED)}")
    code, channels = STORED[encoding]
    dtype = np.dtype(code).newbyteorder(">" if message.is_bigendian else "<")
    row = width * channels * dtype.itemsize
    step = message.step or row
    data = np.frombuffer(message.data, np.uint8)
    # of planar images some drivers count the rows of colour too, others do not
    rows = height * 3 // 2 if encoding in PLANAR and data.size > step * height else height
    last_row_may_be_short = step * (rows - 1) + row
    if height <= 0 or width <= 0 or step < row or not last_row_may_be_short <= data.size <= step * rows:
        raise InputError(
            f"image message: expected {rows} rows of {step} bytes with {width} pixels '{encoding}' in "
            f"each, got {data.size} bytes"
        )
    lines = np.lib.stride_tricks.as_strided(data, (rows, row), (step, 1), writeable=False)
    pixels = np.ascontiguousarray(lines).view(dtype).reshape(rows, width, channels)
    pixels = pixels.astype(dtype.newbyteorder("="), copy=False)
    return pixels[..., 0] if channels == 1 else pixels


def color_from_image(message: Any) -> ColorImage:
    """(H, W, 3) uint8 RGB of a sensor_msgs/Image.

    Raises:
        InputError: for an encoding without colour or brightness, or data of another size than said.
    """
    pixels = image_array(message)
    if not is_color(message.encoding):
        raise InputError(f"image encoding '{message.encoding}' is no colour image")
    if (fault := unfit_size(message.encoding, pixels)) is not None:
        size = f"{message.width} x {message.height} pixels"
        raise InputError(f"image encoding '{message.encoding}': expected {fault}, got {size}")
    return to_rgb(message.encoding, pixels)


def depth_from_image(message: Any) -> DepthImage:
    """(H, W) uint16 (millimetres by REP-118) or float32 (metres) of a sensor_msgs/Image.

    Raises:
        InputError: for an encoding that is no depth, or data of another size than said.
    """
    pixels = image_array(message)
    if message.encoding not in DEPTH:
        raise InputError(
            f"image encoding '{message.encoding}' is no depth image; expected one of {', '.join(DEPTH)}"
        )
    return pixels


def color_from_compressed(message: Any) -> ColorImage:
    """(H, W, 3) uint8 RGB of a sensor_msgs/CompressedImage (JPEG or PNG).

    Raises:
        InputError: if it cannot be decoded or is no colour image.
    """
    import cv2

    if "compressedDepth" in message.format:
        raise InputError(f"expected a compressed colour image, got format '{message.format}'")
    if is_video(message.format):
        raise InputError(f"image format '{message.format}': {VIDEO_REMEDY}")
    image = _decoded(
        message, np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    )
    # format 'rgb8; jpeg compressed bgr8': what is in the file is what OpenCV takes for BGR, whatever
    # the encoding before; a file written from RGB without a swap says 'compressed rgb8'
    swapped = message.format.rstrip().endswith("compressed rgb8")
    return np.ascontiguousarray(image if swapped else image[..., ::-1])


def depth_from_compressed(message: Any) -> DepthImage:
    """(H, W) depth of a compressedDepth message (PNG or RVL), or of a plain 16-bit PNG.

    16-bit depth is stored as it is. Of 32FC1, the file holds inverse depth in whole numbers:
    depth = A / (number - B), 0 = no reading (compressed_depth_image_transport, codec.cpp).

    Returns:
        (H, W) uint16 in the units of the recording, or float32 metres with NaN for no reading.

    Raises:
        InputError: for a wrong header, or a file that cannot be decoded.
    """
    form = message.format
    data = np.frombuffer(message.data, np.uint8)
    if data[: len(JPEG_START)].tobytes() == JPEG_START:
        raise InputError(
            f"compressed depth image '{form}': it is a JPEG, which has 8 bits and rounds distances. Record "
            "the raw depth, or compressedDepth (PNG or RVL)"
        )
    headed = data[: len(_PNG)].tobytes() != _PNG
    if headed and data.size <= _DEPTH_HEADER.size:
        raise InputError(f"compressed depth: expected a 12-byte header and a PNG, got {data.size} bytes")
    numbers = _depth_numbers(message, data[_DEPTH_HEADER.size :] if headed else data)
    if numbers.ndim != 2 or numbers.dtype != np.uint16:
        raise InputError(
            f"compressed depth image '{form}': expected one channel of 16 bits, got {numbers.dtype} of "
            f"shape {numbers.shape}"
        )
    if not form.strip().startswith("32FC1"):
        return numbers
    if not headed:
        raise InputError(f"compressed depth image '{form}': expected the 12-byte header before the PNG")
    _, a, b = _DEPTH_HEADER.unpack(data[: _DEPTH_HEADER.size].tobytes())
    if not (np.isfinite([a, b]).all() and a > 0):
        raise InputError(f"compressed depth image '{form}': unusable quantisation parameters {a}, {b}")
    inverse = numbers.astype(np.float32) - np.float32(b)
    with np.errstate(divide="ignore"):
        metres = np.float32(a) / inverse
    return np.where((numbers > 0) & (inverse > 0), metres, np.float32(np.nan))


def _depth_numbers(message: Any, data: NDArray[np.uint8]) -> NDArray[Any]:
    import cv2

    if "rvl" in message.format.lower():
        return decode_rvl(data.tobytes())
    return _decoded(message, data, cv2.IMREAD_UNCHANGED)


def _decoded(message: Any, data: NDArray[np.uint8], flags: int) -> NDArray[Any]:
    return decode(data.tobytes(), f"compressed image '{message.format}'", flags)


def pose_from_odometry(message: Any) -> Pose:
    """Pose T_odom_base of a nav_msgs/Odometry.

    Raises:
        InvalidValueError: for NaN or a quaternion that is not of length 1.
    """
    pose = message.pose.pose
    return Pose.from_quaternion(
        message.header.frame_id, message.child_frame_id, *vectors(pose.position, pose.orientation)
    )


def vectors(place: Any, turn: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Translation and quaternion (x, y, z, w) of the parts of a ROS transform or pose, unchecked."""
    return (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)
