"""Chunks of recordings unpacked no farther than their headers say.

rosbags unpacks a chunk as a whole before it compares its size with the header (MCAP) or does not compare it
(ROS 1), so that a chunk of some kilobytes may take all memory. It keeps its decoders in tables.
"""

from swardmap.io.unpacking import MAX_UNPACKED_BYTES, unbz2, unlz4, unzstd


def bound_chunks() -> None:
    """Put decoders with a bound into the tables of rosbags; whole chunks are unpacked as before."""
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import storage_mcap as mcap

    mcap.DECOMPRESSORS |= {
        "lz4": lambda data, size: unlz4(data, min(size, MAX_UNPACKED_BYTES)),
        "zstd": lambda data, size: unzstd(data, min(size, MAX_UNPACKED_BYTES)),
    }
    ros1.decompressors |= {
        "bz2": lambda data: unbz2(data, MAX_UNPACKED_BYTES),
        "lz4": lambda data: unlz4(data, MAX_UNPACKED_BYTES),
    }
