"""MCAP files whose writer said nothing of their kind, though their messages are those of ROS 2.

The format lets the profile in the header be empty; libraries that know no ROS leave it so. rosbags wants it
to say `ros2`. What the messages are stands with each channel, and is judged there.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import BinaryIO


@contextmanager
def empty_profile_is_ros2() -> Iterator[None]:
    """Inside, the first file that rosbags opens may have an empty profile."""
    from rosbags.rosbag2 import storage_mcap

    original = storage_mcap.read_string

    def first(bio: BinaryIO) -> str:
        storage_mcap.read_string = original  # the profile is the first text of a file
        return original(bio) or "ros2"

    storage_mcap.read_string = first
    try:
        yield
    finally:
        storage_mcap.read_string = original
