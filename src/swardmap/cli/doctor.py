"""`swardmap doctor`: what works on this machine."""

import json
import os
import platform
import shutil
import tempfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import typer

from swardmap.cli.options import Json
from swardmap.errors import require

Check = tuple[str, bool, str]


def doctor(as_json: Json = False) -> None:
    """Say what works on this machine: packages, kernels, model, camera, viewer, gardens, ROS.

    What is missing is named with the command that installs it. Exits with 1 if something that every user
    needs does not work. Example: swardmap doctor
    """
    needed = [_check(name, probe) for name, probe in NEEDED.items()]
    optional = [_check(name, probe) for name, probe in OPTIONAL.items()]
    if as_json:
        rows = {name: {"works": ok, "about": about} for name, ok, about in [*needed, *optional]}
        print(json.dumps(rows, indent=2))
    else:
        for title, checks in (("needed", needed), ("optional", optional)):
            print(f"{title}:")
            for name, ok, about in checks:
                print(f"  {'ok ' if ok else '-- '} {name:<18} {about}")
    if not all(ok for _, ok, _ in needed):
        raise typer.Exit(1)


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
