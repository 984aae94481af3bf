"""`swardmap convert`: maps, costmaps, clouds, annotations and recordings from one format to another."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from swardmap.cli.convert_recording import Span, convert_recording
from swardmap.cli.options import Classes, ConfigFile, Json, Settings, meanings, settings, tell_guesses
from swardmap.errors import InputError, OutputError
from swardmap.grid import OccupancyGrid
from swardmap.io import is_named
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.mapping.costmap import Costmap

MAPS, PICTURES = (".yaml", ".yml", ".npz"), (".png", ".jpg", ".jpeg")
CLOUDS = (".pcd", ".ply", ".bin")
ANNOTATIONS = (".json", ".xml")


def convert(
    source: Annotated[Path, typer.Argument(help="Map, costmap, cloud, annotations or recording to read.")],
    target: Annotated[Path, typer.Argument(help="What to write; its suffix says the format.")],
    classes: Classes = None,
    names: Annotated[
        Path | None, typer.Option(help="rviz_cloud_annotation: the text file with the names of the labels.")
    ] = None,
    frame: Annotated[str | None, typer.Option(help="Clouds: name of the frame, if not in the file.")] = None,
    unlabeled: Annotated[
        str | None, typer.Option(help="Clouds without labels: class of every point.")
    ] = None,
    ascii_text: Annotated[bool, typer.Option("--ascii", help="Clouds: write numbers as text.")] = False,
    ignore_yaw: Annotated[
        bool, typer.Option("--ignore-yaw", help="Maps: ignore a turned origin, as Nav2 does.")
    ] = False,
    point_floats: Annotated[
        int | None, typer.Option(help="Clouds in .bin: numbers a point, 4 or 5; none = by the content.")
    ] = None,
    every: Annotated[int, typer.Option(help="Recordings: every n-th frame.", min=1)] = 1,
    from_s: Annotated[
        float, typer.Option("--from", help="Recordings: seconds after the first frame to begin at.", min=0)
    ] = 0.0,
    to_s: Annotated[
        float | None, typer.Option("--to", help="Recordings: seconds after the first frame to end at.", min=0)
    ] = None,
    images: Annotated[
        bool, typer.Option("--images", help="Recordings: colour images alone, to annotate them.")
    ] = False,
    config: ConfigFile = None,
    set_: Settings = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace TARGET if it exists.")] = False,
    as_json: Json = False,
) -> None:
    """Convert a map, a costmap, a labelled cloud, annotations, or a recording.

    Maps and costmaps: .yaml (with .pgm, as Nav2's map_server reads it), .npz; to a picture: .png, .jpg.

    Clouds: .pcd (ascii, binary, compressed), .ply, .bin with .label (SemanticKITTI).

    Annotations to a folder of masks: of CVAT, CamVid, COCO, Label Studio, Roboflow.

    Recordings of any kind to a folder in our layout, or with --images to images.

    \b
    Examples:
      swardmap convert drive.mcap drive/ --every 10 --from 5 --to 60
      swardmap convert drive.mcap images/ --every 30 --images
      swardmap convert map.yaml map.png
      swardmap convert cvat_export/ masks/ --class lawn=grass --class tree=other
      swardmap convert 000123.bin lawn.pcd --class 72=grass --class '*=other'
    """  # noqa: D301 - \b is click's sign to leave line breaks alone
    said = meanings(classes or [])
    named = is_named(str(source))
    if not named and not source.exists():
        raise InputError(f"no such file or folder: {source}")
    if source.resolve() == target.resolve():
        raise OutputError(f"source and target are the same: {source}")
    suffix = "" if named or source.is_dir() else source.suffix.lower()
    if suffix in MAPS:
        result = _convert_map(source, target, ignore_yaw, overwrite)
    elif suffix in CLOUDS:
        points = (point_floats, frame, unlabeled, ascii_text)
        result = _convert_cloud(source, target, said, names, points, overwrite)
    elif suffix in ANNOTATIONS or (source.is_dir() and _is_annotated(source)):
        result = _convert_annotations(source, target, said, overwrite)
    else:
        chosen = settings(config, [*(set_ or []), *([f"source.every={every}"] if every > 1 else [])])
        span = Span(from_s, to_s)
        result = convert_recording(str(source), target, chosen, span, images, overwrite, as_json)
    if as_json:
        print(json.dumps(result))
    else:
        counts = ", ".join(
            f"{key} {value}" for key, value in result.items() if key not in ("written", "kind")
        )
        print(f"wrote {result['kind']} {result['written']}: {counts}")


def _convert_map(source: Path, target: Path, ignore_yaw: bool, overwrite: bool) -> dict[str, Any]:
    from swardmap.io.maps.map_files import is_costmap, read_costmap, read_map, write_costmap, write_map
    from swardmap.io.maps.npz_files import read_npz, write_npz

    if source.suffix.lower() == ".npz":
        grid = read_npz(source)
    else:
        grid = read_costmap(source) if is_costmap(source) else read_map(source, ignore_yaw)
    _check_target(target, (".yaml", ".npz", *PICTURES), overwrite)
    suffix = target.suffix.lower()
    if suffix in PICTURES:
        from swardmap.viz.pictures import costmap_picture, map_picture, write_picture

        picture = costmap_picture(grid) if isinstance(grid, Costmap) else map_picture(grid)
        write_picture(picture, target)
    elif suffix == ".npz":
        write_npz(grid, target)
    elif isinstance(grid, Costmap):
        write_costmap(grid, target)
    else:
        write_map(grid, target)
    size = {"width": grid.spec.width, "height": grid.spec.height, "resolution_m": grid.spec.resolution_m}
    if not isinstance(grid, OccupancyGrid):
        return {"kind": "costmap", "written": str(target), **size}
    cells = {map_class.name.lower(): grid.count(map_class) for map_class in MapClass}
    return {"kind": "map", "written": str(target), **size, **cells}


def _convert_cloud(
    source: Path,
    target: Path,
    said: Mapping[str, str],
    names: Path | None,
    options: tuple[int | None, str | None, str | None, bool],
    overwrite: bool,
) -> dict[str, Any]:
    from swardmap.io.annotations.annotation_files import read_annotated_cloud
    from swardmap.io.clouds.cloud_files import label_points, read_points, write_cloud

    point_floats, frame, unlabeled, ascii_text = options
    _check_target(target, CLOUDS, overwrite)
    points = read_points(source, point_floats)
    if names is not None:
        cloud = read_annotated_cloud(source, names, GRASS_OBSTACLE_PERSON, said, frame)
    else:
        table = _ids_named(said, points.ids)
        label_set = None if "classes" in points.own and table is None else GRASS_OBSTACLE_PERSON
        cloud = label_points(points, label_set, table, frame, unlabeled)
    write_cloud(cloud, target, ascii_text)
    without = len(points.xyz) - len(cloud)
    return {"kind": "cloud", "written": str(target), "points": len(cloud), "without a reading": without}


def _convert_annotations(
    source: Path, target: Path, said: Mapping[str, str], overwrite: bool
) -> dict[str, Any]:
    from swardmap.io.annotations.annotation_files import read_masks
    from swardmap.io.annotations.mask_folder import write_masks

    masks = read_masks(source, GRASS_OBSTACLE_PERSON, said, guess=True)
    tell_guesses(masks)
    if not len(masks):
        raise InputError(f"{source}: no annotated image in it")
    pixels = write_masks(masks, target, overwrite)
    return {"kind": "masks", "written": str(target), "images": len(masks), **pixels}


def _is_annotated(folder: Path) -> bool:
    from swardmap.io.annotations.annotation_files import is_annotated

    return is_annotated(folder)


def _ids_named(said: Mapping[str, str], ids: Any) -> dict[int, str] | None:
    """`--class 72=grass` for a cloud: ids to names; * for all ids that occur and have none."""
    if not said:
        return None
    strange = [key for key in said if key != "*" and not (key.isascii() and key.isdigit() and len(key) < 10)]
    if strange:
        raise typer.BadParameter(
            f"--class: the labels of this cloud are numbers: expected 72=grass, got '{strange[0]}=...'"
        )
    table = {int(key): name for key, name in said.items() if key != "*"}
    if "*" in said and ids is not None:
        table |= {i: said["*"] for i in set(ids.tolist()) if i not in table}
    return table


def _check_target(target: Path, suffixes: tuple[str, ...], overwrite: bool) -> None:
    if target.suffix.lower() not in suffixes:
        raise OutputError(f"{target}: expected a name ending in {', '.join(suffixes)}")
    beside = {".yaml": (".pgm", "_costs.pgm"), ".bin": (".label",)}.get(target.suffix.lower(), ())
    for file in (target, *(target.with_name(target.stem + ending) for ending in beside)):
        if file.exists() and not overwrite:
            raise OutputError(f"{file} exists: choose another name, or pass --overwrite")
