"""Every reader of bytes from outside, and small good files for each to begin from."""

import importlib
import importlib.util
import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from swardmap.config import AreaConfig, Config, SourceConfig, config_from_dict, config_to_yaml, load_config
from swardmap.geometry import Intrinsics
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io import open_source
from swardmap.io.annotations.annotation_files import read_masks
from swardmap.io.bags.ros_fields import camera_info_fields, image_fields, tf_fields
from swardmap.io.clouds.cloud_files import read_cloud, write_cloud
from swardmap.io.clouds.mat_files import read_mat, write_mat
from swardmap.io.door import frames_of
from swardmap.io.images import read_color, read_depth, read_mask
from swardmap.io.maps.area_files import read_area
from swardmap.io.maps.map_files import read_costmap, read_map, write_map
from swardmap.io.maps.margin_file import Margin, margin_text, read_margin
from swardmap.io.maps.npz_files import read_npz, write_npz
from swardmap.io.sources.eden_labels import label_table_yaml, read_label_table
from swardmap.io.sources.folder import write_folder
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.rig import rig
from swardmap.runs.recording import map_recording
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.synth.census import census_of
from tests.bags import IMAGE, INFO, TF, Event, Kind, bare_file, write_bag
from tests.fuzz import saved

LENS = Intrinsics(48, 36, 40.0, 40.0, 23.5, 17.5)
LIVING = config_from_dict(
    {
        "segmenter": {"name": "truth"},
        "grid": {"mode": "log_odds", "resolution_m": 0.2},
        "output": {"pictures": 0},
    }
)
SQUARE = [[0.0, 0.0], [0.0002, 0.0], [0.0002, 0.0002], [0.0, 0.0002], [0.0, 0.0]]


@dataclass(frozen=True)
class Reader:
    """One reader.

    Attributes:
        read: a file, or a folder that the file is in; raises SwardmapError for what is wrong.
        good: contents to begin from.
        suffix: of the file.
        around: files that it needs beside it, by name; then `name` is its own.
        name: of the file.
    """

    read: Callable[[Path], Any]
    good: tuple[bytes, ...]
    suffix: str = ""
    around: Path | None = None
    name: str = ""


def drive() -> AnalyticSource:
    """Two small frames."""
    return AnalyticSource(garden_scene(0), tuple(lane_poses(2, step_m=0.4)), LENS)


def _events() -> Iterator[Event]:
    for frame in drive():
        assert frame.T_map_camera is not None
        at = 1_700_000_000_000_000_000 + frame.stamp_ns
        yield at, "/tf", TF, tf_fields([frame.T_map_camera], at)
        yield at, "/color/image_raw", IMAGE, image_fields(frame.rgb, at, "camera")
        yield at, "/color/camera_info", INFO, camera_info_fields(LENS, at, "camera")
        yield at, "/depth/image_raw", IMAGE, image_fields(frame.depth, at, "camera")
        yield at, "/depth/camera_info", INFO, camera_info_fields(LENS, at, "camera")


def _bag(folder: Path, kind: Kind) -> bytes:
    bag = write_bag(folder, kind, _events())
    return (bag if kind == "ros1" else bare_file(bag)).read_bytes()


def _frames(path: Path) -> int:
    source = open_source(path, SourceConfig())
    return sum(1 for _ in frames_of(source, source.name))


def readers(corpus: Path) -> dict[str, Reader]:
    """All readers by name; their good files are written to a folder.

    Args:
        corpus: an empty folder.
    """
    grid = OccupancyGrid(GridSpec(0.1, 6, 4), np.arange(24, dtype=np.uint8).reshape(4, 6) % 4, 1)
    write_map(grid, corpus / "m.yaml")
    write_npz(grid, corpus / "m.npz")
    write_mat(corpus / "d.mat", {"Depth": np.ones((3, 4, 1), np.float32)})
    frame = next(iter(drive()))
    cloud = map_recording(drive(), corpus / "map", LIVING)
    assert cloud.grid is not None
    recording = corpus / "recording"
    write_folder(drive(), recording)
    found: dict[str, Reader] = {}
    found |= _images(frame)
    found |= _clouds(corpus)
    found |= _texts(corpus)
    for module in ("cdr", "ros1"):  # the same code for the same messages of each bag: most of the time
        compiler = importlib.import_module(f"rosbags.serde.{module}")
        compiler.compile_lines = _once_for_each(compiler.compile_lines)  # type: ignore[attr-defined]
    for kind, suffix in (("ros1", ".bag"), ("sqlite3", ".db3"), ("mcap", ".mcap")):
        found[f"bag {kind}"] = Reader(_frames, (_bag(corpus, kind),), suffix)  # type: ignore[arg-type]
    for name in ("camera.yaml", "poses.txt", "rgb/000000.png", "depth/000001.png", "labels/000000.png"):
        good = (recording / name).read_bytes()
        found[f"folder {name}"] = Reader(lambda p, n=name: _frames(_up(p, n)), (good,), "", recording, name)  # type: ignore[misc]
    found["living map"] = Reader(*saved.living_map(corpus / "map/living.npz", LIVING), ".npz")
    found["map npz"] = Reader(read_npz, ((corpus / "m.npz").read_bytes(),), ".npz")
    found["map yaml"] = Reader(read_map, ((corpus / "m.yaml").read_bytes(),), "", corpus, "m.yaml")
    found["map pgm"] = Reader(
        lambda p: read_costmap(p.parent / "m.yaml"), ((corpus / "m.pgm").read_bytes(),), "", corpus, "m.pgm"
    )
    found["mat"] = Reader(lambda p: read_mat(p, ("Depth",)), ((corpus / "d.mat").read_bytes(),), ".mat")
    evaluation = corpus / "evaluation"
    for name in saved.evaluation(evaluation):
        whole = ((evaluation / name).read_bytes(),)
        for verb, read in (("evaluation", saved.read_evaluation), ("compare", saved.compare)):
            found[f"{verb} {name.split('/')[0]}"] = Reader(read, whole, "", evaluation, name)
    found["assets"] = Reader(*saved.assets(corpus), ".zip")
    found["network metadata"] = Reader(*saved.network_metadata(), ".json")
    if importlib.util.find_spec("torch") is not None:
        found["checkpoint"] = Reader(*saved.checkpoint(corpus), ".pt")
    return found


def _once_for_each(compiler: Callable[[list[str]], Any]) -> Callable[[list[str]], Any]:
    known = lru_cache(2000)(lambda text: compiler([text]))
    return lambda lines: known("\n".join(lines))


def _up(path: Path, name: str) -> Path:
    return path.parents[len(Path(name).parts) - 1]


def _images(frame: Any) -> dict[str, Reader]:
    colors = tuple(
        bytes(cv2.imencode(s, frame.rgb)[1]) for s in (".png", ".jpg", ".bmp", ".tiff", ".webp", ".ppm")
    )
    return {
        "colour image": Reader(read_color, colors),
        "depth image": Reader(read_depth, (bytes(cv2.imencode(".png", frame.depth)[1]),), ".png"),
        "depth npy": Reader(read_depth, (_npy(frame.depth), _npy(frame.depth.astype(np.float32))), ".npy"),
        "mask": Reader(read_mask, (bytes(cv2.imencode(".png", frame.labels)[1]),), ".png"),
    }


def _npy(array: Any) -> bytes:
    import io

    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def _clouds(corpus: Path) -> dict[str, Reader]:
    from swardmap.types import LabeledCloud

    points = np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32)
    cloud = LabeledCloud(points, np.arange(20, dtype=np.uint8) % 3, "map", GRASS_OBSTACLE_PERSON)
    found = {}
    for suffix in (".pcd", ".ply"):
        goods = []
        for text in (False, True):
            write_cloud(cloud, corpus / f"c{text}{suffix}", ascii_text=text)
            goods.append((corpus / f"c{text}{suffix}").read_bytes())
        found[f"cloud {suffix[1:]}"] = Reader(read_cloud, tuple(goods), suffix)
    return found


def _texts(corpus: Path) -> dict[str, Reader]:
    coco = {
        "images": [{"id": 1, "file_name": "a.png", "height": 9, "width": 9}],
        "categories": [{"id": 1, "name": "grass"}, {"id": 2, "name": "person"}],
        "annotations": [{"image_id": 1, "category_id": 1, "segmentation": [[0, 0, 8, 0, 8, 8]]},
                        {"image_id": 1, "category_id": 2, "bbox": [1, 1, 3, 3],
                         "segmentation": {"counts": [10, 5, 66], "size": [9, 9]}}],
    }  # fmt: skip
    cvat = (
        "<annotations><version>1.1</version><meta><task><labels><label><name>grass</name></label></labels>"
        "</task></meta>"
        '<image id="0" name="a.png" width="9" height="9">'
        '<polygon label="grass" points="0,0;8,0;8,8" z_order="0"/>'
        '<box label="grass" xtl="1" ytl="1" xbr="3" ybr="3" z_order="1"/></image></annotations>'
    )
    polygon = {"type": "Polygon", "coordinates": [SQUARE]}
    lawn = {"type": "Feature", "properties": {"role": "boundary"}, "geometry": polygon}
    geojson = {"type": "FeatureCollection", "features": [lawn]}
    ring = " ".join(f"{x},{y},0" for x, y in SQUARE)
    kml = (
        '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>'
        "<name>lawn</name><Polygon>"
        f"<outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon>"
        "</Placemark></Document></kml>"
    )
    rig_yaml = "cameras:\n  front: {source: 'realsense:1', mount: {height_m: 0.5, pitch_deg: 10}}\n"
    facts = {
        "pixels": {"other": 3, "grass": 4, "person": 0},
        "kinds": {"pot": 2},
        "poses": {},
        "distances": {"grass": [1, 2]},
    }
    gardens = corpus / "gardens" / "clear"
    gardens.mkdir(parents=True)
    (gardens / "frames.jsonl").write_text(json.dumps(facts) + "\n")

    def area(path: Path) -> Any:
        return read_area(AreaConfig(file=str(path), datum_lat=0.0, datum_lon=0.0))

    def masks(path: Path) -> Any:
        return [read_masks(path)[name] for name in list(read_masks(path))[:4]]

    found = {
        "config": Reader(
            load_config, (config_to_yaml(Config()).encode(), config_to_yaml(LIVING, False).encode()), ".yaml"
        ),
        "rig": Reader(rig.read_rig, (rig_yaml.encode(),), ".yaml"),
        "margin": Reader(read_margin, (margin_text(Margin(0.1, 0.2), "because").encode(),), ".yaml"),
        "label table": Reader(read_label_table, (label_table_yaml(GRASS_OBSTACLE_PERSON).encode(),), ".yaml"),
        "coco": Reader(masks, (json.dumps(coco).encode(),), ".json"),
        "cvat": Reader(masks, (cvat.encode(),), ".xml"),
        "geojson": Reader(area, (json.dumps(geojson).encode(),), ".geojson"),
        "kml": Reader(area, (kml.encode(),), ".kml"),
        "gardens facts": Reader(
            lambda p: census_of(p.parent), (json.dumps(facts).encode(),), "", gardens, "frames.jsonl"
        ),
    }
    return found | _class_lists(corpus, coco)


def _class_lists(corpus: Path, coco: Any) -> dict[str, Reader]:
    """The small files beside masks that say what colours and numbers mean, and Label Studio's JSON."""
    image = np.zeros((9, 9, 3), np.uint8)
    image[:4, :, 1] = 255
    for folder in ("SegmentationClass", "trainannot", "."):
        here = corpus / "masks" / folder
        here.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(here / "a.png"), image)
        cv2.imwrite(str(here / "a_mask.png"), image[..., 1] // 255)
    (corpus / "masks" / "train.txt").write_text("/train/a.png /trainannot/a.png\n")
    texts = {
        "labelmap.txt": "# label:color_rgb:parts:actions\nbackground:0,0,0::\ngrass:0,255,0::\n",
        "label_colors.txt": "0 0 0 background\n0 255 0 grass\n",
        "_classes.csv": "Pixel Value, Class\n0, background\n1, grass\n",
    }
    points = [[0, 0], [99, 0], [99, 99]]
    result = {
        "type": "polygonlabels", "original_width": 9, "original_height": 9,
        "value": {"polygonlabels": ["grass"], "points": points},
    }  # fmt: skip
    brush = {
        **result,
        "type": "brushlabels",
        "value": {"brushlabels": ["person"], "rle": [0, 0, 2, 88, 9, 9, 4]},
    }
    task = {"data": {"image": "a.png"}, "annotations": [{"result": [result, brush]}]}

    def masks(path: Path) -> Any:
        found = read_masks(path if path.suffix == ".json" else path.parent)
        return [found[name] for name in list(found)[:4]]

    found = {
        name: Reader(masks, (text.encode(),), "", corpus / "masks", name) for name, text in texts.items()
    }
    found["label studio"] = Reader(masks, (json.dumps([task]).encode(), json.dumps(coco).encode()), ".json")
    return found


def placed(reader: Reader, content: bytes, folder: Path) -> Path:
    """The file with a content, with all that it needs around it.

    Args:
        reader: that is to read it.
        content: of the file.
        folder: kept between calls for one reader.
    """
    if reader.around is None:
        path = folder / f"case{reader.suffix}"
    else:
        if not folder.exists():
            shutil.copytree(reader.around, folder)
        path = folder / reader.name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path
