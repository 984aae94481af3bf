"""Which topics of a recording hold colour, depth and their cameras."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.io.bags.reader import Bag, Topic
from swardmap.io.bags.ros_messages import (
    ColorImage,
    DepthImage,
    color_from_compressed,
    color_from_image,
    depth_from_compressed,
    depth_from_image,
)

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

_COLOR_CODES = ("rgb8", "bgr8", "rgba8", "bgra8", "8UC3", "8UC4")
_GRAY_CODES = ("mono8", "8UC1")
_ALIGNED = ("aligned_depth", "registered")


@dataclass(frozen=True, slots=True)
class ImageTopic:
    """A topic with images.

    Attributes:
        name: of the topic.
        compressed: whether it holds CompressedImage.
        frame_id: of its first image.
        info: name of the topic with its CameraInfo, or None.
    """

    name: str
    compressed: bool
    frame_id: str
    info: str | None

    @property
    def rectified(self) -> bool:
        """Whether its images are without distortion already, by the names that image_proc gives."""
        return "rect" in _base(self.name).rsplit("/", 1)[-1]

    @property
    def aligned(self) -> bool:
        """Whether it says of itself that its depth is in the pixels of the colour image."""
        return any(word in self.name for word in _ALIGNED)

    def color(self, message: Any) -> ColorImage:
        """(H, W, 3) uint8 RGB of a message of this topic."""
        return color_from_compressed(message) if self.compressed else color_from_image(message)

    def depth(self, message: Any) -> DepthImage:
        """(H, W) uint16 or float32 of a message of this topic."""
        return depth_from_compressed(message) if self.compressed else depth_from_image(message)


@dataclass(frozen=True, slots=True)
class _Candidate:
    topic: Topic
    code: str  # encoding or format of the first image
    frame_id: str

    @property
    def is_depth(self) -> bool:
        code = self.code.split(";")[0].strip()
        named = "depth" in self.topic.name.lower()
        return code in ("16UC1", "32FC1") or "compressedDepth" in self.code or (code == "mono16" and named)

    @property
    def is_color(self) -> bool:
        if self.topic.type == COMPRESSED:
            return not self.is_depth
        return self.code in _COLOR_CODES + _GRAY_CODES

    @property
    def color_rank(self) -> tuple[bool, bool]:
        """Colour before gray (which may be an infrared image), rectified before raw."""
        gray = self.code.split(";")[0].strip() in _GRAY_CODES
        return not gray, "rect" in self.topic.name

    @property
    def depth_rank(self) -> tuple[bool, bool]:
        """Aligned to colour before not aligned, rectified before raw."""
        return any(word in self.topic.name for word in _ALIGNED), "rect" in self.topic.name


def choose_topics(bag: Bag, config: SourceConfig) -> tuple[ImageTopic, ImageTopic]:
    """The colour and the depth topic: as configured, else the only best candidate of each.

    Raises:
        InputError: if a configured topic is not there or holds no such images, or there is none or more
            than one to choose from; the message lists the topics.
    """
    candidates = _candidates(bag)
    color = _choose(
        bag, candidates, "color", config.color_topic, lambda c: c.is_color, lambda c: c.color_rank
    )
    depth = _choose(
        bag, candidates, "depth", config.depth_topic, lambda c: c.is_depth, lambda c: c.depth_rank
    )
    return (
        _with_info(bag, color, config.color_info_topic),
        _with_info(bag, depth, config.depth_info_topic),
    )


def _candidates(bag: Bag) -> dict[str, _Candidate]:
    found = {}
    for topic in bag.topics.values():
        if topic.type not in (IMAGE, COMPRESSED):
            continue
        data = bag.first(topic.name)
        if data is None:
            continue
        message = bag.decode(topic.name, data)
        code = message.encoding if topic.type == IMAGE else message.format
        found[topic.name] = _Candidate(topic, code, message.header.frame_id.strip("/"))
    return found


def _choose(
    bag: Bag,
    candidates: Mapping[str, _Candidate],
    what: str,
    wanted: str | None,
    fits: Callable[[_Candidate], bool],
    rank: Callable[[_Candidate], tuple[bool, bool]],
) -> _Candidate:
    if wanted is not None:
        if wanted in candidates and (fits(candidates[wanted]) or candidates[wanted].code == "mono16"):
            return candidates[wanted]
        problem = f"{what}_topic '{wanted}' holds no {what} images"
        raise InputError(_with_table(bag, candidates, problem))
    fitting = _without_doubles([c for c in candidates.values() if fits(c)])
    best = [c for c in fitting if rank(c) == max(map(rank, fitting))]
    if len(best) == 1:
        return best[0]
    problem = f"{len(best)} topics could be the {what} image" if best else f"no topic with {what} images"
    remedy = f"; choose one with --set source.{what}_topic=..." if best else ""
    raise InputError(_with_table(bag, candidates, problem + remedy))


def _without_doubles(candidates: list[_Candidate]) -> list[_Candidate]:
    """Of an image that was recorded raw and compressed, the raw one."""
    raw = {c.topic.name for c in candidates if c.topic.type == IMAGE}
    seen: dict[str, _Candidate] = {}
    for candidate in candidates:
        base = _base(candidate.topic.name)
        if candidate.topic.type == IMAGE or base not in raw:
            seen.setdefault(base, candidate)
    return list(seen.values())


def _with_info(bag: Bag, candidate: _Candidate, wanted: str | None) -> ImageTopic:
    name = candidate.topic.name
    infos = [t.name for t in bag.topics.values() if t.type == CAMERA_INFO and t.count]
    if wanted is not None and wanted not in infos:
        listed = ", ".join(infos) or "none"
        raise InputError(f"{bag.path}: no CameraInfo in topic '{wanted}'; topics with CameraInfo: {listed}")
    info = wanted or next((place for place in _places_of_info(name) if place in infos), None)
    return ImageTopic(name, candidate.topic.type == COMPRESSED, candidate.frame_id, info)


def _places_of_info(image_topic: str) -> list[str]:
    """Where publishers put the CameraInfo of an image, the usual place first."""
    base = _base(image_topic)
    parent = base.rpartition("/")[0]
    grandparent = parent.rpartition("/")[0]
    return [
        f"{parent}/camera_info",
        f"{base}/camera_info",
        f"{grandparent}/info/camera_info",  # librealsense
        f"{grandparent}/camera_info",
    ]


def _base(topic: str) -> str:
    """Topic of the raw image that an image_transport topic goes with."""
    for suffix in ("/compressed", "/compressedDepth"):
        topic = topic.removesuffix(suffix)
    return topic


def _with_table(bag: Bag, candidates: Mapping[str, _Candidate], problem: str) -> str:
    rows = [(t.name, t.type, str(t.count), _role(t, candidates.get(t.name))) for t in bag.topics.values()]
    widths = [max((len(row[i]) for row in rows), default=0) for i in range(3)]
    lines = [
        f"  {name:<{widths[0]}}  {kind:<{widths[1]}}  {count:>{widths[2]}}  {role}".rstrip()
        for name, kind, count, role in rows
    ]
    return f"{bag.path}: {problem}. Topics (name, type, messages, what it could be):\n" + "\n".join(lines)


def _role(topic: Topic, candidate: _Candidate | None) -> str:
    if candidate is not None:
        what = "depth" if candidate.is_depth else "colour" if candidate.is_color else "image"
        return f"{what} ({candidate.code})"
    if topic.type == CAMERA_INFO:
        return "camera"
    tf = topic.type.rsplit("/", 1)[-1] in ("TFMessage", "tfMessage")
    return "poses" if tf or topic.type == "nav_msgs/msg/Odometry" else ""
