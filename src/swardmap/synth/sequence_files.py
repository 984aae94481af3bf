"""One drive in one light as files: EDEN's layout, our folder layout with maps, and what was drawn.

OUT/eden/                                  all sequences, in EDEN's own layout, with exact depth
OUT/folder/SCENE/LIGHT/                    one sequence, in our layout, with the sensor's depth
OUT/folder/SCENE/LIGHT/exact/              the same recording with exact depth (colour, labels: links)
OUT/folder/SCENE/LIGHT/instances/, .json   which thing each pixel is (see `io.sources.truth`)
OUT/folder/SCENE/LIGHT/ground.npz          where the ground lies
OUT/folder/SCENE/LIGHT/maps/scene.*        the true map of all that stands still: PGM + YAML, npz
OUT/folder/SCENE/LIGHT/maps/NAME.npz       the true map of what is ahead of a frame
OUT/folder/SCENE/LIGHT/frames.jsonl        counts of each frame, for the census
OUT/folder/SCENE/LIGHT/meta.json           seeds, light, camera, depth sensor: all that was drawn
OUT/folder/SCENE/LIGHT/complete.json       written last: the sequence is whole
"""

import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.config import SourceConfig
from swardmap.errors import InputError, OutputError
from swardmap.grid import OccupancyGrid
from swardmap.io.door import read_json
from swardmap.io.files import read_bytes, write_bytes, write_text
from swardmap.io.images import encode_png
from swardmap.io.maps.map_files import write_map
from swardmap.io.maps.npz_files import write_npz
from swardmap.io.sources import folder
from swardmap.io.sources.eden import write_eden
from swardmap.io.sources.eden_layout import MODALITIES
from swardmap.io.sources.truth import GROUND, IMAGES, TABLE, KnownThing, write_ground, write_things
from swardmap.synth.census import FACTS_FILE, frame_facts
from swardmap.synth.config import MapConfig
from swardmap.synth.instances import ground_raster, instance_ids, known_things
from swardmap.synth.sequence import GardenSource, Shot, to_millimetres
from swardmap.synth.truth import frame_map
from swardmap.types import Frame

MAX_MARKER_BYTES = 10_000
COMPLETE_FILE, META_FILE = "complete.json", "meta.json"
LINKED = ("rgb", "labels", folder.POSES_FILE)
"""What `exact/` shares with the recording it lies in."""


def folder_of(out: Path, scene: str, light: str) -> Path:
    """Where a sequence is in our layout."""
    return out / "folder" / scene / light


def is_complete(out: Path, scene: str, light: str, frames: int) -> bool:
    """Whether a sequence is there, whole, with so many frames."""
    try:
        marker = read_json(folder_of(out, scene, light) / COMPLETE_FILE, {"frames": int}, MAX_MARKER_BYTES)
        return bool(marker["frames"] == frames)
    except InputError:
        return False


def discard(out: Path, scene: str, light: str) -> None:
    """Remove what an interrupted run left of a sequence.

    Raises:
        OutputError: if it cannot be removed.
    """
    here = folder_of(out, scene, light)
    (here / COMPLETE_FILE).unlink(missing_ok=True)
    for path in (here, _scratch(out, scene, light), *(out / "eden" / m / scene / light for m in MODALITIES)):
        try:
            if path.exists():
                shutil.rmtree(path)
        except OSError as error:
            raise OutputError(f"cannot remove the unfinished {path}: {error.strerror or error}") from error


def write_sequence(
    source: GardenSource,
    out: Path,
    scene: str,
    scene_grid: OccupancyGrid | None,
    maps: MapConfig,
    meta: Callable[[], Mapping[str, Any]],
    on_frame: Callable[[], None],
) -> None:
    """Film a sequence and write everything of it; the marker comes last.

    Args:
        source: what to film.
        out: folder of all sequences; nothing of this one may be there (see `discard`).
        scene: four digits.
        scene_grid: from `scene_map`; None writes no maps.
        maps: their settings.
        meta: tells all that was drawn; asked at the end, when the driver is known.
        on_frame: called after each frame.

    Raises:
        OutputError: if it cannot be written.
    """
    light = source.light.illumination
    here, scratch = folder_of(out, scene, light), _scratch(out, scene, light)
    facts: list[str] = []
    things: dict[int, KnownThing] = {}

    def frames() -> Iterator[Frame]:
        for shot in source.shots():
            _write_truth(shot, source, scene_grid, maps, scratch)
            things.update(_write_instances(shot, source, scratch))
            facts.append(json.dumps(_facts(shot, source)))
            yield shot.frame
            on_frame()

    count = folder.write_folder(frames(), here)
    _move(scratch / IMAGES, here / IMAGES)
    write_things(here / TABLE, things)
    write_ground(here / GROUND, ground_raster(source.garden.ground))
    if scene_grid is not None:
        _move(scratch / "maps", here / "maps")
        write_map(scene_grid, here / "maps" / "scene.yaml")
        write_npz(scene_grid, here / "maps" / "scene.npz")
    write_eden(_with_exact_depth(here, scratch), out / "eden", scene=scene, illumination=light)
    if source.sensor is not None:
        _write_exact(here, scratch)
    shutil.rmtree(scratch, ignore_errors=True)
    write_text(here / FACTS_FILE, "\n".join(facts) + "\n")
    write_text(here / META_FILE, json.dumps(meta(), indent=2) + "\n")
    write_text(here / COMPLETE_FILE, json.dumps({"frames": count}) + "\n")


def _write_truth(
    shot: Shot, source: GardenSource, scene_grid: OccupancyGrid | None, maps: MapConfig, scratch: Path
) -> None:
    """Put beside what the layouts cannot hold yet: unrounded depth, and the map of the frame."""
    frame = shot.frame
    write_bytes(
        scratch / "depth" / f"{frame.name}.f32", shot.view.depth_m.astype("<f4").tobytes(), durable=False
    )
    if scene_grid is not None and frame.T_map_camera is not None:
        grid = frame_map(
            source.garden, scene_grid, frame.intrinsics, frame.T_map_camera, frame.stamp_ns, maps
        )
        write_npz(grid, scratch / "maps" / f"{frame.name}.npz")


def _write_instances(shot: Shot, source: GardenSource, scratch: Path) -> dict[int, KnownThing]:
    """Put beside which thing each pixel is; what the ids stand for."""
    frame, ground = shot.frame, source.garden.ground
    assert frame.T_map_camera is not None  # noqa: S101 - narrows the type
    ids = instance_ids(shot.view, ground, frame.intrinsics, frame.T_map_camera)
    write_bytes(scratch / IMAGES / f"{frame.name}.png", encode_png(ids), durable=False)
    return known_things(ids, source.garden.at(frame.stamp_ns), ground)


def _facts(shot: Shot, source: GardenSource) -> dict[str, Any]:
    frame = shot.frame
    return {
        "name": frame.name,
        "stamp_ns": frame.stamp_ns,
        "blurred": shot.blurred,
        "heavy_loss": shot.heavy_loss,
        "readings": round(float(np.count_nonzero(frame.depth)) / frame.depth.size, 4),
        **frame_facts(shot.view, source.garden.at(frame.stamp_ns)),
    }


def _exact_depth(scratch: Path, frame: Frame) -> np.ndarray[Any, np.dtype[np.float32]]:
    content = read_bytes(scratch / "depth" / f"{frame.name}.f32")
    return np.frombuffer(content, "<f4").reshape(frame.depth.shape).astype(np.float32)


def _with_exact_depth(here: Path, scratch: Path) -> Iterator[Frame]:
    for frame in folder.open_source(here, SourceConfig()):
        yield replace(frame, depth=_exact_depth(scratch, frame), depth_unit_m=1.0)


def _write_exact(here: Path, scratch: Path) -> None:
    """The same recording with exact depth in millimetres, for `evaluate --clean`."""
    exact = here / "exact"
    for frame in folder.open_source(here, SourceConfig()):
        millimetres = to_millimetres(_exact_depth(scratch, frame))
        write_bytes(exact / "depth" / f"{frame.name}.png", encode_png(millimetres), durable=False)
    try:
        for name in LINKED:
            if (here / name).exists():
                (exact / name).symlink_to(Path("..") / name)
        camera = read_bytes(here / folder.CAMERA_FILE)
    except (OSError, InputError) as error:
        raise OutputError(f"cannot write {exact}: {error}") from error
    write_bytes(exact / folder.CAMERA_FILE, camera)


def _move(source: Path, target: Path) -> None:
    try:
        source.rename(target)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror or error}") from error


def _scratch(out: Path, scene: str, light: str) -> Path:
    return out / "folder" / scene / f".{light}.part"
