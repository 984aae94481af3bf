"""sensor_msgs/CameraInfo to an ideal pinhole camera, and images rectified to it."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Float32Array, Float64Array, Intrinsics
from swardmap.io.bags.encodings import ColorImage
from swardmap.io.bags.ros_messages import DepthImage

POLYNOMIAL = ("plumb_bob", "rational_polynomial", "Brown Conrady", "Modified Brown Conrady")
COEFFICIENTS = (4, 5, 8, 12, 14)
"""Of a polynomial, in OpenCV's order: radial and tangential, rational, thin prism, tilted sensor."""
INVERSE = ("Inverse Brown Conrady",)
"""librealsense's name for a polynomial that goes from the distorted pixel to the ideal one."""
FISHEYE = ("equidistant", "fisheye", "Kannala Brandt4")
"""Kannala and Brandt's model, OpenCV's cv2.fisheye: four coefficients; with all zero still a fisheye."""
IDEAL = ("", "none", "None", "pinhole", *POLYNOMIAL, *INVERSE)
"""Models that are a pinhole if all coefficients are zero."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """A camera as calibrated: the ideal pinhole it is rectified to, and the way there.

    Attributes:
        intrinsics: of the rectified image, which has the size of the image as taken.
        distortion: coefficients of the lens, OpenCV's order; empty where the image is ideal already.
        inverse: whether the polynomial goes from the distorted to the ideal pixel.
        fisheye: whether the coefficients are those of an equidistant lens.
    """

    intrinsics: Intrinsics
    distortion: tuple[float, ...] = ()
    inverse: bool = False
    fisheye: bool = False
    _maps: list[tuple[Float32Array, Float32Array]] = field(default_factory=list, repr=False)

    def rectify_color(self, image: ColorImage) -> ColorImage:
        """The image without distortion, bilinear; black where the lens did not see."""
        self._check_size("colour image", image)
        return np.asarray(self._remapped(image, "INTER_LINEAR"), np.uint8) if self.distortion else image

    def rectify_depth(self, image: DepthImage) -> DepthImage:
        """The image without distortion, nearest neighbour: depths are never blended over an edge."""
        self._check_size("depth image", image)
        return self._remapped(image, "INTER_NEAREST") if self.distortion else image

    def _check_size(self, what: str, image: NDArray[Any]) -> None:
        size = (self.intrinsics.height, self.intrinsics.width)
        if image.shape[:2] != size:
            raise InputError(
                f"{what}: expected {size[1]} x {size[0]} as in its CameraInfo, got "
                f"{image.shape[1]} x {image.shape[0]}; is the CameraInfo topic that of another stream?"
            )

    def _remapped(self, image: NDArray[Any], interpolation: str) -> NDArray[Any]:
        import cv2

        if not self._maps:
            self._maps.append(self._build_maps())
        return np.asarray(cv2.remap(image, *self._maps[0], getattr(cv2, interpolation)))

    def _build_maps(self) -> tuple[Float32Array, Float32Array]:
        """Where each pixel of the ideal image is in the image as taken: columns and rows."""
        import cv2

        camera = self.intrinsics
        K, D = camera.matrix, np.array(self.distortion)
        size = (camera.width, camera.height)
        if self.fisheye:
            x, y = cv2.fisheye.initUndistortRectifyMap(K, D, np.eye(3), K, size, cv2.CV_32FC1)
            return np.asarray(x), np.asarray(y)
        if not self.inverse:
            x, y = cv2.initUndistortRectifyMap(K, D, np.eye(3), K, size, cv2.CV_32FC1)
            return np.asarray(x), np.asarray(y)
        pixels = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 1, 2)
        taken = cv2.undistortPoints(pixels.astype(np.float64), K, D, P=K)  # solves the polynomial backwards
        maps = np.asarray(taken, np.float32).reshape(size[1], size[0], 2)
        return np.ascontiguousarray(maps[..., 0]), np.ascontiguousarray(maps[..., 1])


def calibration_from_camera_info(message: Any, rectified: bool = False, topic: str = "") -> Calibration:
    """Calibration of the image that a CameraInfo goes with (binning and region of interest included).

    Args:
        message: sensor_msgs/CameraInfo of ROS 1 (`K`, `D`, `P`) or ROS 2 (`k`, `d`, `p`).
        rectified: whether the image is rectified already; then P holds, not K and D.
        topic: for messages.

    Raises:
        InputError: if the camera is not calibrated, or its lens model is not supported.
    """
    who = f"CameraInfo {topic}".strip()
    K, P = _numbers(message, "k", 9).reshape(3, 3), _numbers(message, "p", 12).reshape(3, 4)
    D = _numbers(message, "d", None)
    if K[0, 0] == 0 and not (rectified and P[0, 0] > 0):
        raise InputError(
            f"{who}: the camera is not calibrated (K is all zero). Calibrate it, or name a topic with the "
            "right CameraInfo with --set source.color_info_topic=... or source.depth_info_topic=..."
        )
    matrix = P[:, :3] if rectified and P[0, 0] > 0 else K
    try:
        intrinsics = _of_the_image(message, matrix)
    except InvalidValueError as error:
        raise InputError(f"{who}: {error}") from error
    model = message.distortion_model
    if rectified or (model in IDEAL and not np.any(D)):
        return Calibration(intrinsics)
    finite = bool(np.isfinite(D).all())
    if model in FISHEYE and finite and len(D) in (0, 4):
        return Calibration(intrinsics, tuple(float(c) for c in D) or (0.0,) * 4, fisheye=True)
    if model not in POLYNOMIAL + INVERSE or len(D) not in COEFFICIENTS or not finite:
        raise InputError(
            f"{who}: lens model '{model}' with {len(D)} coefficients is not supported; expected "
            f"{' or '.join((*POLYNOMIAL[:2], FISHEYE[0]))}. Record a rectified topic (image_rect, from "
            "image_proc)."
        )
    return Calibration(intrinsics, tuple(float(c) for c in D), model in INVERSE)


def _numbers(message: Any, name: str, count: int | None) -> Float64Array:
    """Field `k` of ROS 2 or `K` of ROS 1."""
    values = np.array(
        getattr(message, name, None) if hasattr(message, name) else getattr(message, name.upper())
    )
    if count is not None and values.size != count:
        raise InputError(f"CameraInfo: expected {count} numbers in {name.upper()}, got {values.size}")
    return values.astype(np.float64)


def _of_the_image(message: Any, matrix: Float64Array) -> Intrinsics:
    """K or P is that of the whole sensor; the image may be a part of it, binned (as image_geometry)."""
    roi = message.roi
    whole = not (roi.width and roi.height)
    width, height = (message.width, message.height) if whole else (roi.width, roi.height)
    x, y = (0, 0) if whole else (roi.x_offset, roi.y_offset)
    bin_x, bin_y = max(1, message.binning_x), max(1, message.binning_y)
    return Intrinsics(
        int(width // bin_x),
        int(height // bin_y),
        float(matrix[0, 0] / bin_x),
        float(matrix[1, 1] / bin_y),
        float((matrix[0, 2] - x) / bin_x),
        float((matrix[1, 2] - y) / bin_y),
    )
