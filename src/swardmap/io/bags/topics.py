"""Which topics of a recording hold colour, depth and their cameras."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.io.bags.encodings import ColorImage, is_color, is_gray, is_video
from swardmap.io.bags.reader import Bag, Topic
from swardmap.io.bags.ros_messages import (
    VIDEO_REMEDY,
    DepthImage,
    color_from_compressed,
    color_from_image,
    depth_from_compressed,
    depth_from_image,
)

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

_ALIGNED = ("aligned_depth", "registered", "depth_to_rgb", "depth_to_color")
_DEPTH_NAMES = ("depth", "stereo")
_RENDERED = ("rgb_to_depth", "color_to_depth")
_VIDEO_TYPES = ("FFMPEGPacket", "CompressedVideo")


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
        named = any(word in self.topic.name.lower() for word in _DEPTH_NAMES)
        return code in ("16UC1", "32FC1") or "compressedDepth" in self.code or (code == "mono16" and named)

    @property
    def is_color(self) -> bool:
        if self.topic.type == COMPRESSED:
            return not self.is_depth and not is_video(self.code)
        return is_color(self.code)

    @property
    def color_rank(self) -> tuple[bool, bool, bool]:
        """Colour before gray (perhaps infrared), as seen before re-rendered, rectified before raw."""
        seen = not any(word in self.topic.name for word in _RENDERED)
        return not is_gray(self.code), seen, "rect" in self.topic.name

    @property
    def depth_rank(self) -> tuple[bool, bool]:
        """Aligned to colour before not aligned, rectified before raw."""
        return any(word in self.topic.name for word in _ALIGNED), "rect" in self.topic.name


def choose_topics(bag: Bag, config: SourceConfig, notes: list[str]) -> tuple[ImageTopic, ImageTopic]:
    """The colour and the depth topic of one camera: as configured, else the only best candidate of each.

    Args:
        bag: the recording.
        config: topics that are named.
        notes: gets what was taken for granted.

    Raises:
        InputError: if a configured topic is not there or holds no such images, or there is none or more
            than one to choose from; the message lists the topics.
    """
    candidates = _candidates(bag)
    if config.color_topic is None and config.depth_topic is not None:
        depth = _choose_depth(bag, candidates, candidates, config)
        color = _choose_color(bag, candidates, _of_camera(depth, candidates, lambda c: c.is_color), config)
    else:
        color = _choose_color(bag, candidates, candidates, config)
        depth = _choose_depth(bag, candidates, _of_camera(color, candidates, lambda c: c.is_depth), config)
    if is_gray(color.code):
        notes.append(f"the images of {color.topic.name} are gray ({color.code}): no colour tells grass")
    return (
        _with_info(bag, color, config.color_info_topic),
        _with_info(bag, depth, config.depth_info_topic),
    )


Candidates = Mapping[str, _Candidate]
Fits = Callable[[_Candidate], bool]


def _choose_color(bag: Bag, every: Candidates, some: Candidates, config: SourceConfig) -> _Candidate:
    wanted = config.color_topic
    return _choose(bag, every, some, "color", wanted, lambda c: c.is_color, lambda c: c.color_rank)


def _choose_depth(bag: Bag, every: Candidates, some: Candidates, config: SourceConfig) -> _Candidate:
    wanted = config.depth_topic
    return _choose(bag, every, some, "depth", wanted, lambda c: c.is_depth, lambda c: c.depth_rank)


def _of_camera(chosen: _Candidate, candidates: Candidates, fits: Fits) -> Candidates:
    """Of the candidates of a kind, those nearest by name to one already chosen, best those of its frame.

    The depth that a second camera aligned to its own colour image is never that of the first.
    """
    fitting = [c for c in candidates.values() if fits(c)]
    common = {c.topic.name: _common_levels(c.topic.name, chosen.topic.name) for c in fitting}
    near = [c for c in fitting if common[c.topic.name] == max(common.values())]
    same_frame = [c for c in near if c.frame_id == chosen.frame_id]
    return {c.topic.name: c for c in same_frame or near}


def _common_levels(one: str, other: str) -> int:
    """How many namespaces two topics share."""
    levels = zip(one.strip("/").split("/")[:-1], other.strip("/").split("/")[:-1], strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], levels))


def _candidates(bag: Bag) -> dict[str, _Candidate]:
    topics = [t for t in bag.topics.values() if t.type in (IMAGE, COMPRESSED)]
    found = {topic.name: _candidate(bag, topic) for topic in topics}
    return {name: candidate for name, candidate in found.items() if candidate is not None}


def _candidate(bag: Bag, topic: Topic) -> _Candidate | None:
    """What the first message of a topic that is not empty holds."""
    found: _Candidate | None = None
    for message in bag.beginning(topic.name):
        code = message.encoding if topic.type == IMAGE else message.format
        found = _Candidate(topic, code, message.header.frame_id.strip("/"))
        if code and len(message.data):
            break
    return found


def _choose(
    bag: Bag,
    candidates: Candidates,
    some: Candidates,
    what: str,
    wanted: str | None,
    fits: Fits,
    rank: Callable[[_Candidate], tuple[bool, ...]],
) -> _Candidate:
    if wanted is not None:
        if wanted in candidates and (fits(candidates[wanted]) or candidates[wanted].code == "mono16"):
            return candidates[wanted]
        problem = f"{what}_topic '{wanted}' holds no {what} images"
        raise InputError(_with_table(bag, candidates, problem))
    fitting = _without_doubles([c for c in some.values() if fits(c)])
    best = [c for c in fitting if rank(c) == max(map(rank, fitting))]
    if len(best) == 1:
        return best[0]
    problem = f"{len(best)} topics could be the {what} image" if best else f"no topic with {what} images"
    remedy = (
        f"; choose one with --set source.{what}_topic=..." if best else _video_remedy(bag, candidates, what)
    )
    raise InputError(_with_table(bag, candidates, problem + remedy))


def _video_remedy(bag: Bag, candidates: Candidates, what: str) -> str:
    names = [name for name, c in candidates.items() if is_video(c.code)]
    names += [t.name for t in bag.topics.values() if t.type.rsplit("/", 1)[-1] in _VIDEO_TYPES]
    return f"; {', '.join(names)}: {VIDEO_REMEDY}" if names and what == "color" else ""


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
