"""Many recordings at once: each map is that of its recording alone, and a run goes on after anything."""

import json
import re
import shutil
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import markupsafe
import pytest

from swardmap.cli.app import run
from swardmap.config import Config, config_from_dict
from swardmap.errors import InvalidValueError, OutputError
from swardmap.geometry import Intrinsics
from swardmap.io.sources.folder import write_folder
from swardmap.runs.many import map_recordings
from swardmap.runs.recording import map_recording
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.viz.maps_page import MappedRecording, maps_page
from tests.browser import browser, serious_faults

__all__ = ["browser"]

SMALL = Intrinsics(96, 72, 80.0, 80.0, 47.5, 35.5)
TRUTH = config_from_dict({"segmenter": {"name": "truth"}, "output": {"pictures": 0}})
MAP_FILES = ("map.pgm", "map.yaml", "costmap.pgm", "costmap.yaml")


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    root = tmp_path_factory.mktemp("drives")
    places = [root / "monday", root / "friday", root / "again" / "friday"]
    for seed, place in enumerate(places):
        write_folder(AnalyticSource(garden_scene(seed), tuple(lane_poses(3, step_m=0.4)), SMALL), place)
    return places


def mapped(drives: list[Path], out: Path, config: Config = TRUTH, **options: Any) -> dict[str, Any]:
    found: dict[str, Any] = map_recordings(drives, out, config, **options)["recordings"]
    return found


@pytest.mark.parametrize("workers", [1, 2])
def test_each_map_is_that_of_its_recording_alone(drives: list[Path], tmp_path: Path, workers: int) -> None:
    told: list[tuple[int, int]] = []
    found = mapped(drives, tmp_path / "out", workers=workers, on_done=lambda d, n: told.append((d, n)))
    assert list(found) == ["monday", "friday", "friday-2"]
    assert told == [(0, 3), (1, 3), (2, 3), (3, 3)]
    for name, drive in zip(found, drives, strict=True):
        alone = map_recording(drive, tmp_path / name, TRUTH)
        assert found[name] == {"frames": 3, "cells": alone.summary["map"]["cells"]}
        for file in MAP_FILES:
            assert (tmp_path / "out" / name / file).read_bytes() == (tmp_path / name / file).read_bytes()


def test_a_run_goes_on_with_what_is_not_there_and_tries_again_what_failed(
    drives: list[Path], tmp_path: Path
) -> None:
    broken = shutil.copytree(drives[0], tmp_path / "broken")
    depth = next(iter(sorted((broken / "depth").iterdir())))
    whole = depth.read_bytes()
    depth.write_bytes(whole[:200])
    out = tmp_path / "out"
    found = mapped([drives[0], broken], out, workers=1)
    assert "truncated" in found["broken"]["error"]
    assert not (out / "broken").exists()
    kept = (out / "monday" / "map.pgm").stat().st_mtime_ns
    depth.write_bytes(whole)
    again = mapped([drives[0], broken], out, workers=1)
    assert again["broken"] == again["monday"] == found["monday"]
    assert (out / "monday" / "map.pgm").stat().st_mtime_ns == kept
    with pytest.raises(OutputError, match=r"other settings \(recordings\)"):
        mapped(drives, out)
    with pytest.raises(OutputError, match=r"other settings \(config, network\)"):
        mapped([drives[0], broken], out, Config())
    assert list(mapped([drives[1]], out, overwrite=True)) == ["friday"]
    left = [".swardmap", "friday", "plan.json", "report.html", "summary.json"]
    assert sorted(p.name for p in out.iterdir()) == left


def test_ctrl_c_keeps_what_is_whole(drives: list[Path], tmp_path: Path) -> None:
    def stop(done: int, _: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        mapped(drives, tmp_path / "out", workers=2, on_done=stop)
    told: list[int] = []
    assert len(mapped(drives, tmp_path / "out", workers=1, on_done=lambda d, _: told.append(d))) == 3
    assert told[0] >= 1


def test_the_command_says_what_became_of_each(
    drives: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, names = tmp_path / "out", [str(drive) for drive in drives[:2]]
    command = ["map", *names, "-o", str(out), "--segmenter", "truth", "--pictures", "0"]
    assert run([*command, "--workers", "1"]) == 0
    told = capsys.readouterr().out
    assert "monday: 3 frames" in told
    assert f"2 of 2 recordings mapped, a folder each in {out}" in told
    assert run([*command, str(tmp_path / "nothing"), "--overwrite", "--json", "--workers", "1"]) == 1
    captured = capsys.readouterr()
    assert "no such recording" in json.loads(captured.out)["recordings"]["nothing"]["error"]
    assert (
        captured.err
        == "swardmap: 1 of 3 recordings could not be mapped: nothing; the others are in " + f"{out}\n"
    )
    assert run([*command, "--frames", "2"]) == 2
    with pytest.raises(InvalidValueError, match="at least one recording"):
        map_recordings([], out)


@pytest.fixture(scope="module")
def page(drives: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Over three recordings, one of an odd name, one without poses, and what cannot be mapped."""
    root = tmp_path_factory.mktemp("page")
    odd = shutil.copytree(drives[1], root / "a&b #2 <i>")
    without = shutil.copytree(drives[0], root / "no poses")
    (without / "poses.txt").unlink()
    (root / "broken").mkdir()
    mapped([drives[0], odd, without, root / "broken"], root / "out", workers=1)
    return root / "out" / "report.html"


def test_one_page_leads_to_all_maps_and_says_what_could_not_be_mapped(page: Path) -> None:
    html, out = page.read_text(encoding="utf-8"), page.parent
    found = json.loads((out / "summary.json").read_text(encoding="utf-8"))["recordings"]
    assert "<b>3 of 4</b>" in html
    links = {unquote(link) for link in re.findall(r'href="([^"]+)"', html)}
    assert links == {f"{name}/report.html" for name, facts in found.items() if "error" not in facts}
    assert all((out / link).is_file() for link in links)
    assert "<i>" not in html
    monday = found["monday"]["cells"]
    for name in ("grass", "obstacle"):
        assert f"<td>{monday[name] * 0.05**2:.1f}</td>" in html
    assert "no poses: a map each frame" in html
    assert markupsafe.escape(found["broken"]["error"]) in html
    assert html.count("<img ") == 2


def test_pictures_of_a_thousand_maps_are_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swardmap.viz.maps_page.MOST_PICTURES", 2)
    summary = {"frames": 1, "map": {"cells": {"grass": 1, "obstacle": 2, "person": 3}}}
    html = maps_page([MappedRecording(f"r{i}", summary, "data:,") for i in range(3)], 0.05, "", "")
    assert "2 of 3 are shown" in html
    assert html.count("<tr><td>") == 3


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_in_chromium_the_page_fits_and_has_no_serious_fault(
    page: Path, browser: Any, width: int, scheme: str
) -> None:
    tab = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
    tab.goto(page.as_uri())
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert tab.evaluate("[...document.images].every(i => i.complete && i.naturalWidth > 0)")
    assert serious_faults(tab) == []
    tab.click("figure a")
    assert tab.url.endswith("/monday/report.html")
    assert tab.title() == "Map of monday"
    tab.close()
