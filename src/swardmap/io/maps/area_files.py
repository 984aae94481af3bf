"""Work areas: GeoJSON (RFC 7946) and KML in WGS84 degrees, each polygon with its role; YAML in metres."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from swardmap.config import AreaConfig
from swardmap.config.outputs import YAML_SUFFIXES
from swardmap.errors import InputError, InvalidValueError
from swardmap.io.door import parse_yaml, reading, through_door
from swardmap.io.files import read_bytes
from swardmap.io.maps.area_roles import Found, role_of
from swardmap.io.maps.kml import from_kml
from swardmap.mapping.work_area import AreaRole, Polygon, WorkArea, projected

MAX_BYTES = 20_000_000
MAX_POLYGONS = 2_000
RECORD_SEPARATOR = "\x1e"
WGS84_NAMES = ("CRS84", "4326", "WGS84", "WGS 84")


def read_area(config: AreaConfig) -> WorkArea | None:
    """The work area that is configured, in metres of the map frame; None if none is.

    A YAML file is in metres already (`read_metric_area`) and needs no datum.

    Raises:
        InputError: if the file cannot be read or says nothing that holds together.
        ConfigError: without a datum.
        MissingExtraError: without pyproj.
    """
    if config.file is None:
        return None
    if config.file.lower().endswith(YAML_SUFFIXES):
        return read_metric_area(config.file, config.frame_id, config.keep_out_cost)
    polygons, ignored = read_polygons(config.file)
    try:
        return projected(polygons, config, ignored)
    except InvalidValueError as error:
        raise InputError(f"{config.file}: {error}") from error


@through_door("a polygon")
def read_metric_area(path: str | Path, frame_id: str = "map", cost: int = 254) -> WorkArea:
    """One boundary from a YAML file: `polygon_m: [[x, y], ...]` in metres of the map's frame.

    Raises:
        InputError: if it is no such file, or the polygon crosses itself or encloses nothing.
    """
    with reading(path, "'polygon_m: [[x, y], ...]' in metres"):
        tree = parse_yaml(read_bytes(path, MAX_BYTES), path)
        corners = np.asarray(tree["polygon_m"], np.float64)
    try:
        return WorkArea((Polygon(AreaRole.BOUNDARY, (corners,), Path(path).stem),), frame_id, cost)
    except InvalidValueError as error:
        raise InputError(f"{path}: {error}") from error


@through_door("GeoJSON or KML")
def read_polygons(path: str | Path) -> tuple[tuple[Polygon, ...], dict[str, int]]:
    """Read the polygons of a GeoJSON or KML file; which one it is shows in its first character.

    The role is the property (GeoJSON) or ExtendedData (KML) `role`, `type` or `kind`, else the first word of
    the name of the feature, the Placemark or its Folder. Where no polygon has a role, all are boundaries, but
    refused where one lies inside another; where only some have one, the file is refused.

    Returns:
        Polygons in degrees, and how many shapes without an area were left out, by kind.

    Raises:
        InputError: if the file is damaged, too large, in another coordinate system, a role is not known, a
            polygon crosses itself or encloses nothing, or there is none.
    """
    content = read_bytes(path, MAX_BYTES)
    ignored: Counter[str] = Counter()
    try:
        if content[:2] == b"PK":
            raise ValueError("it is zipped (KMZ): unzip it and name the KML inside")
        text = _text(content)
        if text[:1] == "{":
            found = list(_from_geojson(_parsed_json(text), ignored))
        elif text[:1] == "<":
            found = list(from_kml(text, ignored))
        else:
            raise ValueError("expected GeoJSON or KML")
        return _with_roles(found, ignored), dict(ignored)
    except InputError:
        raise
    except Exception as error:
        reason = f"lacks {error}" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise InputError(f"work area {path}: {reason}") from error


def _with_roles(found: list[Found], ignored: Counter[str]) -> tuple[Polygon, ...]:
    if not found:
        others = ", ".join(f"{n} x {kind}" for kind, n in ignored.items())
        raise ValueError(f"expected at least one polygon, got {others or 'nothing'}")
    if len(found) > MAX_POLYGONS:
        raise ValueError(f"expected at most {MAX_POLYGONS} polygons, got {len(found)}")
    without = [name for role, name, _ in found if role is None]
    if without and len(without) < len(found):
        raise ValueError(
            f"expected a role (boundary or exclusion) for every polygon or for none, '{without[0]}' has none"
        )
    polygons = tuple(Polygon(role or AreaRole.BOUNDARY, rings, name) for role, name, rings in found)
    if without:
        _refuse_nested(polygons)
    return polygons


def _refuse_nested(polygons: tuple[Polygon, ...]) -> None:
    """Of polygons without a role one inside another is likely a pond, and would vanish as a boundary."""
    import shapely

    shapes = [shapely.make_valid(shapely.Polygon(p.rings[0], p.rings[1:])) for p in polygons]
    inner, outer = shapely.STRtree(shapes).query(shapes, predicate="covered_by")
    for i, j in zip(inner, outer, strict=True):
        if i != j:
            raise ValueError(
                f"'{polygons[i].name}' lies wholly inside '{polygons[j].name}', and nothing says "
                "whether it may be entered: give every polygon the property role, boundary or exclusion"
            )


def _parsed_json(text: str) -> Any:
    """One JSON text, or GeoJSON text sequences (RFC 8142, also without the separators): a feature a line."""

    def refuse(word: str) -> NoReturn:
        raise ValueError(f"expected finite numbers, got {word}")

    try:
        return json.loads(text, parse_constant=refuse)
    except json.JSONDecodeError as error:
        if error.msg != "Extra data":
            raise
    lines = [line for line in text.replace(RECORD_SEPARATOR, "\n").splitlines() if line.strip()]
    features = [json.loads(line, parse_constant=refuse) for line in lines]
    return {"type": "FeatureCollection", "features": features}


def _text(content: bytes) -> str:
    """The text, in UTF-8 or, as its first bytes say, UTF-16."""
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    return content.decode(encoding).lstrip(f" \t\r\n{RECORD_SEPARATOR}")


def _from_geojson(node: Any, ignored: Counter[str]) -> Iterator[Found]:
    """Polygons of any GeoJSON object; features carry role and name."""
    kind = node["type"]
    crs = json.dumps(node.get("crs")) if node.get("crs") else ""
    if crs and not any(name in crs for name in WGS84_NAMES):
        raise ValueError(f"expected WGS84 longitude and latitude (RFC 7946), got the coordinate system {crs}")
    if kind == "FeatureCollection":
        for i, feature in enumerate(node["features"]):
            yield from _from_feature(feature, f"feature {i}", ignored)
    elif kind == "Feature":
        yield from _from_feature(node, "feature", ignored)
    else:
        for rings in _polygons_of(node, None, ignored):
            yield None, "polygon", rings


def _from_feature(feature: Mapping[str, Any], number: str, ignored: Counter[str]) -> Iterator[Found]:
    if feature["type"] != "Feature":
        raise ValueError(f"{number}: expected a Feature, got {feature['type']}")
    properties = feature.get("properties") or {}
    name = str(next((v for key, v in properties.items() if key.lower() == "name" and v), number))
    role = role_of(properties, name)
    if feature["geometry"] is None:
        ignored["feature without geometry"] += 1
        return
    for rings in _polygons_of(feature["geometry"], role, ignored):
        yield role, name, rings


def _polygons_of(
    geometry: Mapping[str, Any], role: AreaRole | None, ignored: Counter[str]
) -> Iterator[tuple[NDArray[np.float64], ...]]:
    kind = geometry["type"]
    if kind == "Polygon":
        yield _rings(geometry["coordinates"])
    elif kind == "MultiPolygon":
        yield from map(_rings, geometry["coordinates"])
    elif kind == "GeometryCollection":
        for part in geometry["geometries"]:
            yield from _polygons_of(part, role, ignored)
    elif role is not None:
        raise ValueError(f"expected a polygon for the role {role}, got a {kind}: draw it as a polygon")
    else:
        ignored[str(kind)] += 1


def _rings(rings: Any) -> tuple[NDArray[np.float64], ...]:
    """Rings of positions [longitude, latitude, ...]; what comes after, such as the altitude, is left out."""
    if not isinstance(rings, list) or not rings:
        raise ValueError("a polygon without rings")
    found = []
    for ring in rings:
        if not all(isinstance(p, list) and len(p) >= 2 and all(map(_is_number, p[:2])) for p in ring):
            raise ValueError("expected positions of longitude and latitude, as numbers in degrees")
        found.append(np.array([p[:2] for p in ring], np.float64).reshape(-1, 2))
    return tuple(found)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
