"""`swardmap doctor`: what works on this machine."""

import json
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swardmap.cli.compiling import told_when_compiling
from swardmap.cli.options import Json
from swardmap.errors import require

if TYPE_CHECKING:
    from swardmap.runs.speed import Speed

Check = tuple[str, bool, str]


def doctor(
    seconds: Annotated[
        float, typer.Option(min=0, help="Time to measure how fast this machine maps; 0 = do not.")
    ] = 10.0,
    segmenter: Annotated[
        Path | None, typer.Option("--segmenter", help="Network file to tell about: what it was taught.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Say what works on this machine, how fast it maps, and what would make it faster.

    What is missing is named with the command that installs it. Exits with 1 if something that every user
    needs does not work. Example: swardmap doctor
    """
    needed = [_check(name, probe) for name, probe in NEEDED.items()]
    optional = [_check(name, probe) for name, probe in OPTIONAL.items()]
    works = all(ok for _, ok, _ in needed)
    taught = None if segmenter is None else _taught(segmenter)
    if as_json:
        rows: dict[str, Any] = {n: {"works": ok, "about": about} for n, ok, about in [*needed, *optional]}
        if segmenter is not None:
            rows["network"] = {"file": str(segmenter), "taught": taught}
        if works and seconds:
            speeds = measured(seconds)
            rows["speed"] = {"measured": [asdict(s) for s in speeds], "faster": faster(speeds)}
        print(json.dumps(rows, indent=2))
    else:
        for title, checks in (("needed", needed), ("optional", optional)):
            print(f"{title}:")
            for name, ok, about in checks:
                print(f"  {'ok ' if ok else '-- '} {name:<18} {about}")
        if segmenter is not None:
            print("\n".join(taught_lines(segmenter, taught)))
        if works and seconds:
            speeds = measured(seconds)
            print("speed, from a 640 x 480 frame to the map, one after another:")
            print("\n".join(f"     {line}" for line in [*map(speed_line, speeds), *faster(speeds)]))
    if not works:
        raise typer.Exit(1)


def _taught(path: Path) -> dict[str, Any] | None:
    """What `swardmap teach` wrote into a network file; None for one that was not taught."""
    from swardmap.models.onnx import OnnxSegmenter

    found = OnnxSegmenter(path, 1).spec.training.get("taught")
    return found if isinstance(found, dict) else None


def taught_lines(path: Path, taught: dict[str, Any] | None) -> list[str]:
    """What a network was taught, and what that was measured to change."""
    if taught is None:
        return [f"network {path}: not taught by a drive"]
    from swardmap.teach.gate import table

    drives = ", ".join(map(str, taught.get("drives", [])))
    about = f"{taught.get('driven_m2')} m2 of lawn in {taught.get('frames')} frames of {drives}"
    return [
        f"network {path}: taught from {taught.get('from')} ({taught.get('from_digest')}) by {about}",
        *(f"     {line}" for line in table(taught.get("figures", {}))),
    ]


def measured(seconds: float) -> list["Speed"]:
    """The speeds, with a word on what the first run of all waits for."""
    from swardmap.runs.speed import measure_speeds

    print(f"measuring for {seconds:g} s", file=sys.stderr)
    with told_when_compiling():
        return measure_speeds(seconds)


def speed_line(speed: "Speed") -> str:
    """One row of the table."""
    on = "" if speed.provider.startswith("CPU") else f" on {speed.provider}"
    threads = "1 thread" if speed.threads == 1 else f"{speed.threads} threads"
    return (
        f"{speed.frames_per_s:6.1f} frames/s, network {speed.network_ms:.0f} ms with {threads}{on}, "
        f"map {speed.map_ms:.1f} ms"
    )


def faster(speeds: list["Speed"]) -> list[str]:
    """What would make it faster, the first of the speeds being what the settings give now."""
    now, best = speeds[0], max(speeds, key=lambda s: s.frames_per_s)
    advice = []
    if best.frames_per_s > 1.1 * now.frames_per_s:
        settings = [f"--set segmenter.threads={best.threads}"] if best.threads != now.threads else []
        settings += [f"--set segmenter.provider={best.provider}"] if best.provider != now.provider else []
        gain = best.frames_per_s / now.frames_per_s
        advice.append(f"faster: {' '.join(settings)} ({gain:.1f} times as fast, while nothing else runs)")
    offered = {s.provider for s in speeds}
    if shutil.which("nvidia-smi") and not any(p.startswith("CUDA") for p in offered):
        advice.append(
            "perhaps faster: onnxruntime-gpu in place of onnxruntime, which offers CUDAExecutionProvider"
        )
    elif platform.machine() in ("x86_64", "AMD64") and not any(p.startswith("OpenVINO") for p in offered):
        advice.append(
            "perhaps faster: onnxruntime-openvino in place of onnxruntime, for OpenVINOExecutionProvider"
        )
    return [*advice, "less to do: --set source.every=2 maps every second frame"]


def _check(name: str, probe: Callable[[], str]) -> Check:
    try:
        return name, True, probe()
    except Exception as error:  # noqa: BLE001 - whatever it is, the user shall read it here
        return name, False, str(error).splitlines()[0] if str(error) else type(error).__name__


def _python() -> str:
    return f"{platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores"


def _package(module: str) -> Callable[[], str]:
    def probe() -> str:
        return f"version {getattr(import_module(module), '__version__', 'unknown')}"

    return probe


def _kernels() -> str:
    import numpy as np

    from swardmap.kernels import inflation

    out = np.empty((1, 3), np.int32)
    inflation.squared_distances(np.array([[True, False, False]]), 4, out)
    if out.tolist() != [[0, 1, 4]]:
        raise RuntimeError(f"a compiled kernel gave {out.tolist()} in place of [[0, 1, 4]]")
    return "compile and give the right numbers"


def _providers() -> str:
    import onnxruntime

    return ", ".join(onnxruntime.get_available_providers())


def _network() -> str:
    from swardmap.models import bundled_network

    path = bundled_network()
    if path is None:
        raise RuntimeError("none in this package: 'auto' uses the colour index; give your own .onnx file")
    return f"{path.name}, {path.stat().st_size / 1e6:.1f} MB"


def _temporary() -> str:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "probe").write_bytes(b"swardmap")
        free = shutil.disk_usage(folder).free
    return f"writable, {free / 1e9:.1f} GB free"


def _camera() -> str:
    rs = require("pyrealsense2", "realsense", "On Debian it needs: apt-get install libusb-1.0-0")
    known = (rs.camera_info.name, rs.camera_info.serial_number)
    found = [" ".join(device.get_info(key) for key in known) for device in rs.context().query_devices()]
    return ", ".join(found) if found else "package works, no camera is connected"


def _viewer() -> str:
    from swardmap.viz.rerun_sink import has_screen, load_rerun

    where = "a screen" if has_screen() else "no screen: use --save or --connect"
    return f"rerun {load_rerun().__version__}, {where}"


def _work_area() -> str:
    return f"pyproj {require('pyproj', 'gps').__version__}"


def _training() -> str:
    return f"torch {require('torch', 'train').__version__}"


def _cluster() -> str:
    return f"ray {require('ray', 'ray').__version__}"


def _gardens() -> str:
    from swardmap.synth.render.context import driver_of, open_context

    context = open_context()
    try:
        return driver_of(context)
    finally:
        context.release()


def _assets() -> str:
    from swardmap.synth.assets import open_assets

    assets = open_assets()
    return f"{len(assets.kinds())} kinds of models, digest {assets.digest[:12]}"


def _ros() -> str:
    from swardmap.ros.topics import find_types, rclpy_module

    rclpy_module()
    distro = os.environ.get("ROS_DISTRO", "not set")
    return "; ".join([f"rclpy works, ROS_DISTRO={distro}", *find_types().without])


NEEDED: dict[str, Callable[[], str]] = {
    "python": _python,
    "numpy": _package("numpy"),
    "opencv": _package("cv2"),
    "scipy": _package("scipy"),
    "numba": _package("numba"),
    "kernels": _kernels,
    "onnxruntime": _providers,
    "rosbags": lambda: f"version {_version('rosbags')}",
    "temporary folder": _temporary,
}
OPTIONAL: dict[str, Callable[[], str]] = {
    "bundled network": _network,
    "realsense camera": _camera,
    "rerun viewer": _viewer,
    "work area (gps)": _work_area,
    "garden renderer": _gardens,
    "garden assets": _assets,
    "training": _training,
    "cluster": _cluster,
    "ros 2": _ros,
}


def _version(package: str) -> str:
    from importlib import metadata

    return metadata.version(package)
