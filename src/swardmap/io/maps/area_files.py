"""Work areas from GeoJSON (RFC 7946) and KML: polygons in WGS84 degrees, each with its role."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from swardmap.config import AreaConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.io.door import through_door
from swardmap.io.files import read_bytes
from swardmap.mapping.work_area import Polygon, Role, WorkArea, projected

MAX_BYTES = 20_000_000
WGS84_NAMES = ("CRS84", "4326", "WGS84", "WGS 84")

DAMAGE = (ValueError, TypeError, AttributeError, LookupError, OverflowError, RecursionError, ET.ParseError)
"""What a file that is not what it should be makes the parsers raise."""

Found = tuple[str | None, str, tuple[NDArray[np.float64], ...]]
"""Role as written or None, name, rings of (longitude, latitude)."""


def read_area(config: AreaConfig) -> WorkArea | None:
    """The work area that is configured, in metres of the map frame; None if none is.

    Raises:
        InputError: if the file cannot be read or says nothing that holds together.
        ConfigError: without a datum.
        MissingExtraError: without pyproj.
    """
    if config.file is None:
        return None
    polygons, ignored = read_polygons(config.file)
    try:
        return projected(polygons, config, ignored)
    except InvalidValueError as error:
        raise InputError(f"{config.file}: {error}") from error


@through_door("GeoJSON or KML")
def read_polygons(path: str | Path) -> tuple[tuple[Polygon, ...], dict[str, int]]:
    """Read the polygons of a GeoJSON or KML file; which one it is shows in its first character.

    The role is the property `role` (GeoJSON), or the ExtendedData `role`, else the first word of the name of
    the Placemark or its Folder (KML). Where no polygon has a role, all are boundaries; where only some have
    one, the file is refused.

    Returns:
        Polygons in degrees, and how many shapes without an area were left out, by kind.

    Raises:
        InputError: if the file is damaged, too large, in another coordinate system, a role is not known, a
            polygon crosses itself or encloses nothing, or there is none.
    """
    content = read_bytes(path, MAX_BYTES)
    ignored: Counter[str] = Counter()
    start = content.lstrip(b"\xef\xbb\xbf \t\r\n")[:1]
    try:
        if start == b"{":
            found = list(_from_geojson(_parsed_json(content), ignored))
        elif start == b"<":
            found = list(_from_kml(_parsed_xml(content), None, "", ignored))
        elif content[:2] == b"PK":
            raise ValueError("it is zipped (KMZ): unzip it and name the KML inside")
        else:
            raise ValueError("expected GeoJSON or KML")
        return _with_roles(found, ignored), dict(ignored)
    except DAMAGE as error:
        reason = f"lacks {error}" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise InputError(f"work area {path}: {reason}") from error


def _with_roles(found: list[Found], ignored: Counter[str]) -> tuple[Polygon, ...]:
    if not found:
        others = ", ".join(f"{n} x {kind}" for kind, n in ignored.items())
        raise ValueError(f"expected at least one polygon, got {others or 'nothing'}")
    without = [name for role, name, _ in found if role is None]
    if without and len(without) < len(found):
        raise ValueError(
            f"expected a role (boundary or exclusion) for every polygon or for none, '{without[0]}' has none"
        )
    return tuple(Polygon(_role(role, name), rings, name) for role, name, rings in found)


def _role(role: str | None, name: str) -> Role:
    if role is None:
        return Role.BOUNDARY
    try:
        return Role(role.strip().lower())
    except ValueError:
        raise ValueError(f"polygon '{name}': expected the role boundary or exclusion, got '{role}'") from None


def _parsed_json(content: bytes) -> Any:
    def refuse(text: str) -> NoReturn:
        raise ValueError(f"expected finite numbers, got {text}")

    return json.loads(content.decode("utf-8-sig"), parse_constant=refuse)


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
    role, name = properties.get("role"), str(properties.get("name") or number)
    if role is not None and not isinstance(role, str):
        raise ValueError(f"{name}: expected the role to be a word, got {role!r}")
    if feature["geometry"] is None:
        ignored["feature without geometry"] += 1
        return
    for rings in _polygons_of(feature["geometry"], role, ignored):
        yield role, name, rings


def _polygons_of(
    geometry: Mapping[str, Any], role: str | None, ignored: Counter[str]
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


class _NoDoctype(ET.TreeBuilder):
    """Refuses a document type: it may define entities that grow without end or read files."""

    def doctype(self, *_: str | None) -> None:
        """Called for <!DOCTYPE>."""
        raise ValueError("a document type is not expected in KML")


def _parsed_xml(content: bytes) -> ET.Element:
    parser = ET.XMLParser(target=_NoDoctype())  # noqa: S314 - without a document type no entities
    parser.feed(content)
    root = parser.close()
    assert isinstance(root, ET.Element)  # noqa: S101 - narrows the type: TreeBuilder's result
    if _tag(root) != "kml":
        raise ValueError(f"expected KML, got <{_tag(root)}>")
    return root


def _tag(element: ET.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _from_kml(node: ET.Element, role: str | None, name: str, ignored: Counter[str]) -> Iterator[Found]:
    """Polygons below a node; role and name are those of the nearest Placemark or Folder that has them."""
    tag = _tag(node)
    if tag in ("Placemark", "Folder", "Document"):
        role, name = _kml_role(node) or role, _child_text(node, "name") or name
    if tag == "Polygon":
        yield role, name or "polygon", tuple(_kml_rings(node))
        return
    if tag in ("LineString", "LinearRing", "Point", "Track", "Model"):
        if role is not None and tag in ("LineString", "LinearRing"):
            raise ValueError(f"'{name}': expected a polygon for the role {role}, got a {tag}")
        ignored[tag] += 1
        return
    for child in node:
        yield from _from_kml(child, role, name, ignored)


def _kml_role(node: ET.Element) -> str | None:
    for data in node.findall("{*}ExtendedData//{*}Data") + node.findall("{*}ExtendedData//{*}SimpleData"):
        if data.get("name") == "role":
            return (_child_text(data, "value") or data.text or "").strip()
    words = _child_text(node, "name").lower().replace("_", " ").replace(":", " ").split()
    return words[0] if words and words[0] in tuple(Role) else None


def _child_text(node: ET.Element, tag: str) -> str:
    child = node.find(f"{{*}}{tag}")
    return "" if child is None else (child.text or "").strip()


def _kml_rings(polygon: ET.Element) -> Iterator[NDArray[np.float64]]:
    outer = polygon.findall("{*}outerBoundaryIs/{*}LinearRing/{*}coordinates")
    inner = polygon.findall("{*}innerBoundaryIs/{*}LinearRing/{*}coordinates")
    if len(outer) != 1:
        raise ValueError(f"expected one outerBoundaryIs in a Polygon, got {len(outer)}")
    for element in (*outer, *inner):
        tuples = [word.split(",") for word in (element.text or "").split()]
        if not all(len(numbers) in (2, 3) for numbers in tuples):
            raise ValueError("expected coordinates as longitude,latitude[,altitude], separated by blanks")
        yield np.array([[float(lon), float(lat)] for lon, lat, *_ in tuples]).reshape(-1, 2)
