"""Fixtures shared by all tests: where optional data lies, and small frames with a known map."""

import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from swardmap.geometry import Intrinsics, mount_pose
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.types import Frame, Segmentation
from tests.floor import pytest_addoption, pytest_configure

__all__ = ["pytest_addoption", "pytest_configure"]  # hooks that pytest finds here

# the first example of a property may wait for a kernel to compile
settings.register_profile("swardmap", deadline=None)
settings.load_profile("swardmap")

# a run in the background (nohup make test &) begins with Ctrl-C ignored, and so would all it starts
if (
    signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    and threading.current_thread() is threading.main_thread()
):
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder with the optional real recordings, named by SWARDMAP_DATA."""
    folder = os.environ.get("SWARDMAP_DATA", "")
    if not folder or not Path(folder).is_dir():
        pytest.skip("SWARDMAP_DATA does not name a folder with the optional recordings")
    return Path(folder)


@pytest.fixture
def flat_lawn() -> tuple[Frame, Segmentation]:
    """A camera 1 m above an endless flat lawn, looking down 30 degrees; depth in closed form."""
    intrinsics = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
    T_map_camera = mount_pose(1.0, 30.0, parent="map")
    _, ray_y = intrinsics.ray_tables()
    down = np.sin(np.deg2rad(30)) + np.cos(np.deg2rad(30)) * ray_y.astype(np.float64)
    depth = np.where(down > 0.02, 1.0 / np.maximum(down, 0.02), 0.0)[:, None] * np.ones((1, 160))
    frame = Frame(
        1_000,
        intrinsics,
        np.zeros((120, 160, 3), np.uint8),
        depth.astype(np.float32),
        T_map_camera=T_map_camera,
        labels=np.ones((120, 160), np.uint8),
        label_set=GRASS_OBSTACLE_PERSON,
        name="lawn",
    )
    assert frame.labels is not None
    return frame, Segmentation(frame.labels, GRASS_OBSTACLE_PERSON)
