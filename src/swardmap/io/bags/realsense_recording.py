"""What librealsense writes into its own recordings: where the streams are to each other, and depth units.

The topics are `/device_0/sensor_1/Color_0/image/data` and so on. A .bag (SDK up to 2.55) gives each
stream's place as a transform from a reference stream in `.../tf/<reference>`, and the depth unit in four
bytes behind each image; all its images have the same frame id, wherever they were taken. A .db3
(SDK from 2.57) has /tf_static and is read as any other ROS 2 bag.
"""

import math
import re
import struct

from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.io.bags.reader import Bag
from swardmap.io.bags.ros_messages import vectors

_STREAM = re.compile(r"(/device_\d+/sensor_\d+/\w+_\d+)/image/data")
_SENSOR = re.compile(r"(/device_\d+/sensor_\d+)/")
_TRANSFORM = "geometry_msgs/msg/Transform"


def is_sdk_bag(bag: Bag, image_topic: str) -> bool:
    """Whether a topic was written by librealsense itself into a .bag."""
    return bag.path.suffix == ".bag" and _STREAM.fullmatch(image_topic) is not None


def color_from_depth(bag: Bag, color_topic: str, depth_topic: str) -> Pose:
    """T_color_depth between two streams of a .bag.

    Raises:
        InputError: if their places are not recorded, or to different reference streams.
    """
    (color_to, T_color_ref), (depth_to, T_depth_ref) = (
        _from_reference(bag, topic) for topic in (color_topic, depth_topic)
    )
    if color_to != depth_to:
        raise InputError(
            f"{bag.path}: colour is placed to stream {color_to} and depth to stream {depth_to}; expected the "
            "same. Record both streams of one camera."
        )
    T = T_color_ref @ T_depth_ref.inverse()
    return Pose("color", "depth", T.matrix)


def depth_unit_m(bag: Bag, depth_topic: str) -> float | None:
    """Metres per unit of the depth images of an SDK recording: behind the image, or the sensor's option."""
    unit = 0.0
    image = bag.first(depth_topic)
    behind = b"" if image is None else bag.appended(depth_topic, image)
    if len(behind) == 4:
        unit = struct.unpack("<f", behind)[0]
    sensor = _SENSOR.match(depth_topic)
    option = f"{sensor.group(1)}/option/Depth_Units/value" if sensor else ""
    if not unit and option in bag.topics and (data := bag.first(option)) is not None:
        try:
            unit = float(bag.decode(option, data).data)  # a number in .bag, a text in .db3
        except ValueError:
            unit = 0.0
    if not (math.isfinite(unit) and 1e-6 < unit < 1):
        return None
    return float(f"{unit:.7g}")  # 0.001 as float32 is 0.0010000000475


def _from_reference(bag: Bag, topic: str) -> tuple[str, Pose]:
    """Number of the reference stream, and T_stream_reference."""
    stream = _STREAM.fullmatch(topic)
    prefix = f"{stream.group(1)}/tf/" if stream else topic
    for name, found in bag.topics.items():
        if name.startswith(prefix) and found.type == _TRANSFORM and (data := bag.first(name)) is not None:
            message = bag.decode(name, data)
            place, turn = vectors(message.translation, message.rotation)
            return name.removeprefix(prefix), Pose.from_quaternion("stream", "reference", place, turn)
    raise InputError(
        f"{bag.path}: where {topic} was taken is not recorded (no topic {prefix}...), so depth cannot be "
        "aligned to colour; record with the SDK's align filter, or convert with realsense-ros"
    )
