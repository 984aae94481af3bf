"""Processor time of a frame in the node, without DDS: what can be compared on a busy machine, too.

    python benchmarks/bench_frame.py               # one and two threads of the network, each twice
    python benchmarks/bench_frame.py --kept        # all but the network: masks are kept from a first drive

A rig of two cameras (640 x 480, colour raw, depth 16UC1 aligned) and an odometry, as in `bench_robot.py`, are
handed to the node's pipeline as messages; after each pair a map of 40 x 40 m and its costmap are made.
"""

import argparse
import time
import zlib
from typing import Any

import numpy as np
from bench_robot import RIG, look
from rosbags.typesys import Stores, get_typestore

from swardmap.config import config_from_dict
from swardmap.io.bags.ros_fields import odometry_fields, rosbags_message, time_fields
from swardmap.mapping.costmap import occupancy_from_costs
from swardmap.models import build_segmenter
from swardmap.rig.rig import rig_from_dict
from swardmap.ros.live_pipeline import LivePipeline
from swardmap.ros.parameters import Parameters, parameters_from
from swardmap.ros.warm_up import warm_up
from swardmap.segmenter import Segmenter
from swardmap.types import Frame, Segmentation
from tests.ros.drive import base_at

STORE = get_typestore(Stores.ROS2_JAZZY)
FRAMES, SETTLE = 10, 2
STEP_M, PERIOD_NS, START_NS = 0.05, 66_666_667, 1_700_000_000_000_000_000


def message(topic: str, fields: dict[str, Any], stamp_ns: int) -> Any:
    """A message of a camera at another time."""
    kind = "CameraInfo" if topic.endswith("camera_info") else "Image"
    header = {**fields["header"], "stamp": time_fields(stamp_ns)}
    return rosbags_message(STORE, f"sensor_msgs/msg/{kind}", {**fields, "header": header})


class Kept:
    """Segments each image once; after that its mask costs next to nothing."""

    def __init__(self, segmenter: Segmenter) -> None:
        self._segmenter, self.name, self.label_set = segmenter, segmenter.name, segmenter.label_set
        self._kept: dict[int, Segmentation] = {}

    def __call__(self, frame: Frame) -> Segmentation:
        key = zlib.crc32(frame.rgb[::16].tobytes())
        if key not in self._kept:
            self._kept[key] = self._segmenter(frame)
        return self._kept[key]


def measure(threads: int, kept: bool) -> str:
    """One line: milliseconds of a core for a frame, and for a map with its costmap."""
    settings = {
        "segmenter": {"name": "auto", "threads": threads}, "source": {"odometry_topic": "odom"},
        "grid": {"origin_m": [-20.0, -20.0], "size_m": [40.0, 40.0]},
    }  # fmt: skip
    parameters = parameters_from({}, Parameters(config=config_from_dict(settings)))
    network = build_segmenter(parameters.config.segmenter)
    warm_up(parameters.config, network)
    if not kept:
        return drive(parameters, network)
    segmenter = Kept(network)
    drive(parameters, segmenter)
    return drive(parameters, segmenter)


def drive(parameters: Parameters, segmenter: Segmenter) -> str:
    """The line of one drive."""
    rig = rig_from_dict(RIG)
    pipeline, threads = LivePipeline(parameters, segmenter, rig), parameters.config.segmenter.threads
    frames_ms, maps_ms = list[float](), list[float]()
    for i in range(FRAMES):
        now_ns, T_map_base = START_NS + i * PERIOD_NS, base_at(STEP_M * i)
        odometry = rosbags_message(STORE, "nav_msgs/msg/Odometry", odometry_fields(T_map_base, now_ns))
        pipeline.intake.on_odometry(odometry, now_ns)
        for name in rig.names:
            seen = look(name, rig.T_base_camera(name), STEP_M * i)
            messages = {topic: message(topic, fields, now_ns) for topic, fields in sorted(seen.items())}
            begin = time.process_time()
            for topic, each in messages.items():
                kind, what = topic.split("/")
                if what == "camera_info":
                    pipeline.intake.on_info(name, kind, each)
                else:
                    pipeline.intake.on_image(name, kind, each, now_ns)
            while (mapped := pipeline.process(0)) is not None:
                pipeline.mapped(mapped, now_ns)
            frames_ms.append(1e3 * (time.process_time() - begin))
        begin = time.process_time()
        grid = pipeline.given_out(None)
        costmap = None if grid is None else pipeline.mapper.costmap(grid)
        assert costmap is not None
        occupancy_from_costs(costmap.costs)
        maps_ms.append(1e3 * (time.process_time() - begin))
    assert pipeline.mapper.mapped.total() == 2 * FRAMES
    stages = {name: round(core, 1) for name, (_, core) in pipeline.stages.means_ms.items()}
    frame_ms, map_ms = np.median(frames_ms[2 * SETTLE :]), np.median(maps_ms[SETTLE:])
    return f"| {threads} | {frame_ms:.1f} | {map_ms:.1f} | {stages} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("threads", type=int, nargs="*", default=[1, 2, 1, 2])
    parser.add_argument("--kept", action="store_true", help="leave the network out")
    args = parser.parse_args()
    print("| threads | ms of a core a frame | a map and its costmap | of which (calling thread) |")
    print("|---:|---:|---:|---|")
    for threads in args.threads:
        print(measure(threads, args.kept), flush=True)


if __name__ == "__main__":
    main()
