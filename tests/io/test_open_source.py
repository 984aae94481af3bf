"""The door to all sources: a kind is named in one place, and each takes only what it knows."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import swardmap.io
from swardmap.config import CameraConfig, Config, SourceConfig
from swardmap.errors import ConfigError
from swardmap.geometry import Intrinsics
from swardmap.io import open_source
from swardmap.io.sources.source import Source, Tally
from swardmap.types import Frame
from tests.io.contract import check_source

CAMERA = Intrinsics(4, 3, 3.0, 3.0, 2.0, 1.5)


def toy(path: Path, config: SourceConfig) -> Source:
    def read(tally: Tally) -> Iterator[Frame]:
        for i in range(4):
            if i == 2:
                tally.skip("no colour image", f"frame {i} of {path}")
                continue
            rgb, depth = np.full((3, 4, 3), i, np.uint8), np.full((3, 4), 900, np.uint16)
            yield Frame(i, CAMERA, rgb, depth, config.depth_unit_m or 0.001, name=str(i))

    return Source(path.name, 4, None, read)


def test_a_new_kind_is_one_module_and_one_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module: Any = SimpleNamespace(recognises=lambda path: path.name == "toy", open_source=toy)
    monkeypatch.setitem(sys.modules, "toy_source", module)
    monkeypatch.setattr(swardmap.io, "SOURCES", {**swardmap.io.SOURCES, "toy": "toy_source"})
    (tmp_path / "toy").mkdir()
    frames = check_source(lambda: open_source(tmp_path / "toy"))
    assert [f.name for f in frames] == ["0", "1", "3"]
    named = open_source(tmp_path, SourceConfig(format="toy", depth_unit_m=0.01))
    assert {f.depth_unit_m for f in named} == {0.01}
    assert named.skipped == {"no colour image": 1}
    with pytest.raises(ConfigError, match=r"source\.format: expected one of folder, .*, toy, got 'zip'"):
        open_source(tmp_path, SourceConfig(format="zip"))


def test_a_live_camera_takes_its_own_section(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, Config]] = []
    module: Any = SimpleNamespace(open_live=lambda address, config: asked.append((address, config)))
    monkeypatch.setitem(sys.modules, "toy_camera", module)
    monkeypatch.setattr(swardmap.io, "LIVE", {"toy": "toy_camera"})
    config = Config(camera=CameraConfig(fps=15))
    open_source("toy:left", config)
    open_source("toy:", SourceConfig(every=2))
    assert asked == [("left", config), ("", Config(source=SourceConfig(every=2)))]
