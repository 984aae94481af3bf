"""RVL, the run-length code of 16-bit depth images that compressed_depth_image_transport offers beside PNG.

A. D. Wilson, "Fast lossless depth image compression" (ISS 2017): runs of zeros and of readings in turn, each
reading as its zigzag difference to the one before, all numbers in groups of three bits with a fourth that
says whether more follow; eight groups to a 32-bit word, the first in its highest bits.
"""

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError

MAX_PIXELS = 2**26


def decode_rvl(data: bytes) -> NDArray[np.uint16]:
    """(H, W) uint16 of an RVL image with its head, width and height as 32-bit numbers.

    Raises:
        InputError: if the numbers do not fill the image exactly.
    """
    if len(data) < 8:
        raise InputError(f"RVL depth image: expected a head of 8 bytes, got {len(data)} bytes")
    width, height = (int(n) for n in np.frombuffer(data, "<u4", 2))
    pixels = width * height
    if not 0 < pixels <= MAX_PIXELS or pixels > 2**20 * max(1, len(data)):
        raise InputError(f"RVL depth image: expected a size in pixels, got {width} x {height}")
    zeros, readings, deltas = _runs(_numbers(data[8 : 8 + (len(data) - 8) // 4 * 4]), pixels)
    out = np.zeros(pixels, np.uint16)
    is_reading = np.repeat(np.tile([False, True], len(zeros)), np.column_stack([zeros, readings]).ravel())
    out[is_reading] = np.cumsum((deltas >> 1) ^ -(deltas & 1)).astype(np.uint16)
    return out.reshape(height, width)


def _numbers(words: bytes) -> NDArray[np.int64]:
    """All numbers of the code, in order."""
    octets = np.frombuffer(words, np.uint8).reshape(-1, 4)[:, ::-1].reshape(-1)
    groups = np.stack([octets >> 4, octets & 15], axis=1).reshape(-1)
    ends = np.flatnonzero(groups < 8)
    if not ends.size:
        return np.zeros(0, np.int64)
    groups = groups[: ends[-1] + 1]
    starts = np.concatenate([[0], ends[:-1] + 1])
    place = np.arange(len(groups)) - np.repeat(starts, ends - starts + 1)
    if place.max() > 10:  # 11 groups hold 32 bits
        raise InputError("RVL depth image: damaged, a number is longer than 32 bits")
    bits = (groups & 7).astype(np.int64) << (3 * place)
    return np.add.reduceat(bits, starts)


def _runs(
    numbers: NDArray[np.int64], pixels: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Lengths of the runs of zeros and of readings, and the coded differences of all readings."""
    zeros, readings, where = [], [], []
    at, left = 0, pixels
    while left > 0:
        if at + 2 > len(numbers):
            raise InputError(f"RVL depth image: it ends {left} pixels early. Is it whole?")
        none, some = int(numbers[at]), int(numbers[at + 1])
        left -= none + some
        if left < 0 or at + 2 + some > len(numbers) or none + some == 0:
            raise InputError("RVL depth image: damaged, its runs do not fill the image")
        zeros.append(none)
        readings.append(some)
        where.append(slice(at + 2, at + 2 + some))
        at += 2 + some
    deltas = np.concatenate([numbers[part] for part in where])
    return np.array(zeros, np.int64), np.array(readings, np.int64), deltas
