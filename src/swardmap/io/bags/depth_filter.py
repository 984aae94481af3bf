"""Flying pixels taken out of depth as it came from the sensor, before it is aligned, and out of sparse grids.

Where depth is rendered into a finer colour image each reading becomes a patch, whose pixels agree with each
other: the filter that `swardmap.perception.cloud` applies to images finds nothing any more. And depth that
was registered into a finer image without closing its gaps (depth_image_proc) is a grid of lone pixels, of
which none has a neighbour: it is judged at the resolution that it came from.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig
from swardmap.io.bags.ros_messages import DepthImage
from swardmap.perception.compiled import consistent_pixels
from swardmap.types import depth_in_metres

DENSE, LONE = 5.0, 3.0
"""Mean number of neighbours that have a reading, of 8: in a dense image, and among lone pixels."""

MAX_STRIDE = 6
FEWEST_READINGS = 200


def without_flying_pixels(
    depth: DepthImage, depth_unit_m: float, config: CloudConfig, stride: int = 1
) -> DepthImage:
    """Depth with 0 where too few neighbours agree.

    Args:
        depth: (H, W) uint16 in units of `depth_unit_m`, or float32 metres.
        depth_unit_m: metres per unit; 1 for float32.
        config: neighbours needed, and what agrees.
        stride: see `grid_stride`.

    Returns:
        (H, W) of the same type.
    """
    metres = depth_in_metres(depth, depth_unit_m)
    coarse = metres if stride == 1 else _nearest_of_blocks(metres, stride)
    kept = consistent_pixels(coarse, config)
    if stride > 1:
        kept, of_block = (_spread(a, stride, metres.shape) for a in (kept, coarse))
        tolerance = metres * np.float32(config.consistency_relative) + np.float32(config.consistency_m)
        with np.errstate(invalid="ignore"):
            kept = kept & (np.abs(metres - of_block) <= tolerance)
    return np.where(kept, depth, np.zeros((), depth.dtype))


def grid_stride(depth: DepthImage) -> int | None:
    """Pixels from one reading of a sparse grid to the next; 1 = dense, None = too few readings to tell."""
    seen = np.isfinite(depth) & (depth > 0)
    if np.count_nonzero(seen) < FEWEST_READINGS:
        return None
    if _mean_neighbours(seen) >= LONE:
        return 1
    for stride in range(2, MAX_STRIDE + 1):
        if _mean_neighbours(np.asarray(_blocks(seen, stride, 0).any(axis=(1, 3)))) >= DENSE:
            return stride
    return 1


def _mean_neighbours(seen: NDArray[Any]) -> float:
    """Mean number of neighbours with a reading of the pixels with a reading."""
    padded = np.pad(seen, 1).astype(np.uint8)
    height, width = seen.shape
    around = sum(
        padded[v : v + height, u : u + width].astype(np.int32)
        for v in range(3)
        for u in range(3)
        if (v, u) != (1, 1)
    )
    return float(np.asarray(around)[seen].mean()) if seen.any() else 0.0


def _blocks(image: NDArray[Any], stride: int, fill: float) -> NDArray[Any]:
    """(rows, stride, columns, stride) view of an image, padded to whole blocks."""
    height, width = image.shape
    padded = np.pad(image, ((0, -height % stride), (0, -width % stride)), constant_values=fill)
    return np.asarray(padded.reshape(padded.shape[0] // stride, stride, padded.shape[1] // stride, stride))


def _nearest_of_blocks(metres: NDArray[np.float32], stride: int) -> NDArray[np.float32]:
    blocks = np.where(np.isnan(metres), np.float32(np.inf), metres)
    nearest = _blocks(blocks, stride, np.inf).min(axis=(1, 3))
    return np.where(np.isinf(nearest), np.float32(np.nan), nearest)


def _spread(coarse: NDArray[Any], stride: int, shape: tuple[int, ...]) -> NDArray[Any]:
    """Each block's value at all its pixels."""
    return coarse.repeat(stride, axis=0).repeat(stride, axis=1)[: shape[0], : shape[1]]
