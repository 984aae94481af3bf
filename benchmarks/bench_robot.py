"""The node on two cores: two cameras over real DDS, with the network of the package.

    python benchmarks/bench_robot.py              # about four minutes; needs pip install 'swardmap[ros]'

A rig of two forward cameras (640 x 480, colour raw, depth 16UC1 aligned) and an odometry are played by one
process to `swardmap ros` in another, both held to the same two cores, at several rates. Images are serialised
beforehand, but the player's sending and DDS take their share of the two cores, as cameras' drivers would.
"""

import argparse
import json
import os
import struct
import subprocess
import sys
import tempfile
import time
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parent.parent
SECONDS, SETTLE_S = 25.0, 5.0
VIEWS = 20
FULL = (640, 480)
RIG: dict[str, Any] = {
    "base_frame": "base_link",
    "cameras": {
        "left": {"mount": {"height_m": 0.9, "pitch_deg": 25.0, "x_m": 0.5, "y_m": 0.2, "yaw_deg": 20.0}},
        "right": {"mount": {"height_m": 0.9, "pitch_deg": 25.0, "x_m": 0.5, "y_m": -0.2, "yaw_deg": -20.0}},
    },
}


@dataclass(frozen=True)
class Case:
    """One run."""

    rate_hz: float
    threads: int = 0
    queue_frames: int = 2
    network: str = "auto"

    @property
    def name(self) -> str:
        threads = "" if self.threads == 0 else f", threads: {self.threads}"
        queue = "" if self.queue_frames == 2 else f", queue {self.queue_frames}"
        network = "" if self.network == "auto" else f", {self.network}"
        return f"2 x {self.rate_hz:g} /s{threads}{queue}{network}"


CASES = (
    Case(5), Case(7.5), Case(10), Case(15), Case(15, network="large"), Case(10, network="small"),
    Case(15, threads=1, network="large"), Case(15, threads=1, queue_frames=1, network="large"),
)  # fmt: skip


def environment() -> dict[str, str]:
    return os.environ | {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(1 + os.getpid() % 99),
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(ROOT / "src/swardmap/data/nav2/fastdds.xml"),
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
    }  # fmt: skip


def run(case: Case, folder: Path) -> dict[str, Any]:
    """Start the node, play to it, and what both have measured."""
    namespace = f"/b{uuid.uuid4().hex[:8]}"
    rig, file, out = folder / "rig.yaml", folder / "params.yaml", folder / "out.json"
    cameras = {name: camera | {"rate_hz": case.rate_hz} for name, camera in RIG["cameras"].items()}
    rig.write_text(json.dumps(RIG | {"cameras": cameras}))
    settings = {
        "rig_file": str(rig), "queue_frames": case.queue_frames, "source": {"odometry_topic": "odom"},
        "segmenter": {"name": case.network, "threads": case.threads},
        "watchdog": {"latency_window_s": SECONDS},
        # a lawn of 40 m, as a robot in use would have it
        "grid": {"origin_m": [-20.0, -20.0], "size_m": [40.0, 40.0]},
    }  # fmt: skip
    file.write_text(json.dumps({"/**": {"ros__parameters": settings}}))
    node = [sys.executable, "-m", "swardmap", "ros", "--params", str(file), "--", "-r", f"__ns:={namespace}"]
    player = [sys.executable, __file__, "--play", str(case.rate_hz), namespace, str(out)]
    with subprocess.Popen(node, env=environment(), stderr=subprocess.DEVNULL) as process:
        try:
            before = time.monotonic()
            subprocess.run([*player, str(process.pid)], env=environment(), check=True, timeout=200)
        finally:
            process.terminate()
    told: dict[str, Any] = json.loads(out.read_text())
    return told | {"seconds": time.monotonic() - before}


def play(rate_hz: float, namespace: str, out: Path, pid: int) -> None:
    """Send images of both cameras and poses; listen to the costmap and to what the node says of itself."""
    import rclpy
    from nav_msgs.msg import OccupancyGrid, Odometry
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import CameraInfo, Image, PointCloud2
    from std_msgs.msg import String

    from swardmap.io.bags.ros_fields import odometry_fields
    from swardmap.rig.rig import rig_from_dict
    from swardmap.ros.messages import ros_message
    from tests.ros.drive import base_at

    rig = rig_from_dict(RIG)
    kinds = {"color/image_raw": Image, "depth/image_raw": Image,
             "color/camera_info": CameraInfo, "depth/camera_info": CameraInfo}  # fmt: skip
    xs_m = [0.05 * i for i in range(VIEWS)]
    wire = {
        (name, topic, i): serialize_message(ros_message(kinds[topic], fields))
        for name in rig.names
        for i, x_m in enumerate(xs_m)
        for topic, fields in look(name, rig.T_base_camera(name), x_m).items()
    }
    rclpy.init()
    node = rclpy.create_node("bench", namespace=namespace)
    latched = QoSProfile(
        depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
    )
    pubs = {
        (name, topic): node.create_publisher(kind, f"{name}/{topic}", 5)  # reliable, as realsense2_camera
        for name in rig.names
        for topic, kind in kinds.items()
    }
    odometry = node.create_publisher(Odometry, "odom", 10)
    health: list[dict[str, Any]] = []
    ages_ms: list[float] = []
    node.create_subscription(String, "swardmap/health_json", lambda m: health.append(json.loads(m.data)), 10)

    def on_costs(message: Any) -> None:
        stamp = message.header.stamp
        ages_ms.append((time.time_ns() - stamp.sec * 1_000_000_000 - stamp.nanosec) / 1e6)

    node.create_subscription(OccupancyGrid, "swardmap/costmap", on_costs, latched)
    for name in rig.names:  # as Nav2's obstacle layer would
        topic = f"swardmap/{name}/obstacles"
        node.create_subscription(PointCloud2, topic, lambda _: None, qos_profile_sensor_data)
    while not (health and all(p.get_subscription_count() for p in pubs.values())):
        rclpy.spin_once(node, timeout_sec=0.1)

    begin, sent, marks = time.monotonic(), 0, list[tuple[dict[str, Any], float, int]]()
    while (elapsed := time.monotonic() - begin) < SETTLE_S + SECONDS:
        if elapsed >= SETTLE_S and not marks:
            marks.append((health[-1], cpu_s(pid), sent))
            ages_ms.clear()
        index, stamp_ns = sent % (2 * VIEWS - 2), time.time_ns()
        i = min(index, 2 * VIEWS - 2 - index)
        odometry.publish(ros_message(Odometry, odometry_fields(base_at(xs_m[i]), stamp_ns)))
        for (name, topic), publisher in pubs.items():
            publisher.publish(stamped(wire[name, topic, i], stamp_ns))
        sent += 1
        due = begin + sent / rate_hz
        while (left := due - time.monotonic()) > 0:
            rclpy.spin_once(node, timeout_sec=left)
    (first, cpu, before), last = marks[0], health[-1]
    mapped = {c: last["mapped"].get(c, 0) - first["mapped"].get(c, 0) for c in rig.names}
    told = {
        "offered": sent - before, "mapped": mapped, "ages_ms": ages_ms, "cpu_s": cpu_s(pid) - cpu,
        "health": last, "elapsed_s": time.monotonic() - begin - SETTLE_S,
    }  # fmt: skip
    out.write_text(json.dumps(told))
    rclpy.shutdown()


def look(name: str, T_base_camera: Any, x_m: float) -> dict[str, Any]:
    """What one camera sees with the robot at x: topic -> fields of the message."""
    from swardmap.geometry import Intrinsics
    from swardmap.io.bags.ros_fields import camera_info_fields, image_fields
    from swardmap.synth.analytic import StereoNoise, garden_scene, render, with_sensor_noise
    from tests.ros.drive import base_at

    camera, frame_id = Intrinsics(*FULL, 460.0, 460.0, 319.5, 239.5), f"{name}_optical"
    frame = render(garden_scene(0), camera, base_at(x_m) @ T_base_camera)
    frame = with_sensor_noise(frame, np.random.default_rng(round(100 * x_m)), StereoNoise())
    info = camera_info_fields(camera, 0, frame_id)
    return {"color/image_raw": image_fields(frame.rgb, 0, frame_id),
            "depth/image_raw": image_fields(frame.depth, 0, frame_id),
            "color/camera_info": info, "depth/camera_info": info}  # fmt: skip


def stamped(data: bytes, stamp_ns: int) -> bytes:
    """A serialised message with another stamp: the first field of its header, behind 4 bytes of CDR."""
    changed = bytearray(data)
    struct.pack_into("<iI", changed, 4, stamp_ns // 1_000_000_000, stamp_ns % 1_000_000_000)
    return bytes(changed)


def cpu_s(pid: int) -> float:
    """Time that a process has had, of all its threads (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def report(case: Case, told: dict[str, Any]) -> None:
    """One row of the table."""
    health, seconds, mapped = told["health"], told["elapsed_s"], told["mapped"]
    rates = " + ".join(f"{count / seconds:.1f}" for count in mapped.values())
    dropped = 1 - sum(mapped.values()) / (2 * told["offered"])
    ages = np.percentile(told["ages_ms"], [50, 99]) if told["ages_ms"] else [float("nan")] * 2
    each_ms = 1e3 * told["cpu_s"] / max(1, sum(mapped.values()))
    print(
        f"| {case.name} | {rates} | {100 * dropped:.0f} % | {health['latency_p50_ms']:.0f} | "
        f"{health['latency_p99_ms']:.0f} | {ages[0]:.0f} | {ages[1]:.0f} | {told['cpu_s'] / seconds:.2f} | "
        f"{each_ms:.0f} |",
        flush=True,
    )


def stages(case: Case, told: dict[str, Any]) -> None:
    """Share of each stage of a frame, by time on a core, and what the rest of the node takes."""
    means = dict(told["health"]["stages_ms"])
    maps = means.pop("maps", (0.0, 0.0))
    total = sum(core for _, core in means.values())
    ordered = sorted(means.items(), key=lambda item: -item[1][1])
    shares = ", ".join(f"{name} {100 * core / total:.0f} %" for name, (_, core) in ordered)
    wall = sum(clock for clock, _ in means.values())
    print(f"{case.name}: left out {told['health']['left_out']}")
    print(
        f"{case.name}: a frame {total:.0f} ms of a core ({wall:.0f} ms by the clock): {shares}; "
        f"a map {maps[1]:.0f} ms of a core",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--play", nargs=4, metavar=("RATE", "NAMESPACE", "OUT", "PID"), help=argparse.SUPPRESS
    )
    parser.add_argument("--rates", type=float, nargs="*", help="frames a second of each camera")
    parser.add_argument("--network", default="auto", help="segmenter.name, with --rates")
    args = parser.parse_args()
    if args.play:
        rate, namespace, out, pid = args.play
        play(float(rate), namespace, Path(out), int(pid))
        return
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before the run\n")
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
    heads = ("offered", "mapped /s, left + right", "dropped", "stamp to map p50 ms", "p99",
             "stamp to costmap received p50 ms", "p99", "cores used", "ms of a core a frame")  # fmt: skip
    print(f"| {' | '.join(heads)} |\n|---|{'---:|' * (len(heads) - 1)}")
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for case in [Case(rate, network=args.network) for rate in args.rates] if args.rates else CASES:
            results.append((case, run(case, Path(folder))))
            report(*results[-1])
    print()
    for result in results:
        stages(*result)


if __name__ == "__main__":
    main()
