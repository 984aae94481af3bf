"""Where frames come from: recordings, cameras, the mount, the network."""

from dataclasses import dataclass

from swardmap.config.settings import Checked, setting
from swardmap.errors import ConfigError


@dataclass(frozen=True)
class SourceConfig(Checked):
    """How to read a recording."""

    format: str | None = setting(None, "kind of recording, as docs/recordings.md names it; none = found")
    start: int = setting(0, "index of the first frame to use", minimum=0)
    stop: int | None = setting(None, "index after the last frame to use; none = to the end", minimum=0)
    every: int = setting(1, "use every n-th frame", minimum=1)
    color_topic: str | None = setting(None, "bags: image topic; none = the only candidate")
    depth_topic: str | None = setting(None, "bags: depth topic; none = the only candidate")
    color_info_topic: str | None = setting(None, "bags: CameraInfo of the colour image")
    depth_info_topic: str | None = setting(None, "bags: CameraInfo of the depth image")
    odometry_topic: str | None = setting(
        None, "bags: nav_msgs/Odometry to take the pose from, in place of tf"
    )
    tf_topic: str | None = setting(
        None, "bags: tf of the camera; none = that of the colour image's namespace"
    )
    poses: str = setting(
        "auto", "bags: tf or odometry; none: each frame is mapped on its own", choices=("auto", "none")
    )
    map_frame: str | None = setting(
        None, "bags: fixed frame of the map; none = map, else odom, of the tf tree"
    )
    camera_frame: str | None = setting(
        None, "bags: optical frame of the colour image, where its header is wrong"
    )
    camera_axes: str = setting(
        "auto",
        "bags: of the colour image's frame; body = x forward; auto = optical, refused if it looks up",
        choices=("auto", "optical", "body"),
    )
    depth_aligned: bool | None = setting(
        None, "bags: whether depth is in the pixels of the colour image; none = by its frame and topic"
    )
    T_color_depth: tuple[float, float, float, float, float, float, float] | None = setting(
        None, "bags: where depth is seen from in the colour camera: x y z qx qy qz qw; none = as tf says"
    )
    pair_tolerance_ms: float = setting(20.0, "largest distance in time of colour and depth", minimum=0)
    pose_tolerance_ms: float = setting(
        250.0, "largest gap between poses that is interpolated over", minimum=0
    )
    depth_unit_m: float | None = setting(
        None, "metres per unit of depth; none = as the format says", minimum=1e-6
    )
    intrinsics: tuple[float, float, float, float] | None = setting(
        None, "fx, fy, cx, cy in pixels, where the data does not say; none = as the data or its kind says"
    )
    color_files: str | None = setting(None, "images: pattern of the colour images, such as rgb/*.jpg")
    depth_files: str | None = setting(None, "images: pattern of the depth images, such as depth/*.png")
    poses_file: str | None = setting(None, "images: poses, a line each (docs/recordings.md); none = no poses")
    pair_by: str | None = setting(
        None,
        "images: what says which belong together; none = the numbers in the names, if they agree",
        choices=("name", "time", "order"),
    )
    label_table: str | None = setting(None, "EDEN and others: YAML file that maps ids to classes")
    level: bool = setting(
        True, "3DMatch and others whose map is not level: turn it so that the floor is z = 0"
    )


@dataclass(frozen=True)
class CameraConfig(Checked):
    """A live RealSense camera (docs/live.md)."""

    serial: str | None = setting(None, "serial number, in quotes; none = the only camera")
    width: int = setting(640, "of colour and depth images", minimum=1)
    height: int = setting(480, "of colour and depth images", minimum=1)
    fps: int = setting(30, "images a second", minimum=1)
    align: str = setting(
        "swardmap",
        "depth to colour by our own rule, or by the SDK's rs.align; docs/live.md says how they differ",
        choices=("swardmap", "sdk"),
    )
    decimation: int = setting(1, "depth is reduced by this factor; 1 = not", minimum=1, maximum=8)
    spatial: bool = setting(False, "smooth depth within the image, edges kept")
    temporal: bool = setting(False, "smooth depth over time: for a robot that stands still")
    threshold_m: tuple[float, float] | None = setting(None, "drop readings nearer or farther than this")
    hole_filling: bool = setting(False, "fill holes with a neighbour's depth: invents free space, see docs")
    queue: int = setting(
        1, "pairs of images that wait at most; 1 = always the newest (record: at least 15)", minimum=1
    )
    timeout_s: float = setting(3.0, "without an image for so long the camera is opened anew", minimum=0.1)
    reconnect_s: float = setting(
        30.0, "without an image for so long, unplugged or not, the run ends", minimum=0.1
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.threshold_m is not None and not 0 <= self.threshold_m[0] < self.threshold_m[1]:
            raise ConfigError(
                f"camera: expected threshold_m as nearest and farthest, got {list(self.threshold_m)}"
            )


@dataclass(frozen=True)
class SegmenterConfig(Checked):
    """What tells grass from obstacles."""

    name: str = setting(
        "auto", "an .onnx file, or auto, large, small (faster), colour (excess green), truth (the labels)"
    )
    min_confidence: float = setting(
        0.0, "below it a pixel of grass clears nothing; obstacles count whatever it is", minimum=0, maximum=1
    )
    threads: int = setting(0, "threads of the network; 0 = one a core, 4 at most", minimum=0)
    provider: str = setting("CPUExecutionProvider", "ONNX Runtime execution provider")


@dataclass(frozen=True)
class MountConfig(Checked):
    """Where the camera sits, for recordings without poses, and under it the robot for `swardmap teach`."""

    height_m: float | None = setting(
        None, "of the camera above the ground; none = measured from the ground seen", minimum=0
    )
    pitch_deg: float | None = setting(
        None, "how far it looks down; none = measured from the ground seen", minimum=-90, maximum=90
    )
    roll_deg: float = setting(0.0, "right side down is positive", minimum=-180, maximum=180)
    yaw_deg: float = setting(0.0, "to the left is positive", minimum=-180, maximum=180)
    x_m: float = setting(0.0, "forward of the robot's base")
    y_m: float = setting(0.0, "left of the robot's base")
