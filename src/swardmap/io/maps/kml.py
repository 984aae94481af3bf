"""The polygons of a KML file; its entities, styles and links are not followed."""

import re
from collections import Counter
from collections.abc import Iterator
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from swardmap.io.maps.area_roles import Found, role_of
from swardmap.mapping.work_area import AreaRole


def from_kml(text: str, ignored: Counter[str]) -> Iterator[Found]:
    """Polygons of a KML text, in longitude and latitude; what has no area is counted in `ignored`.

    Raises:
        ValueError: if it is no KML, or a shape is damaged; ET.ParseError if it is no XML.
    """
    yield from _from_kml(_parsed(text), None, "", ignored)


class _NoDoctype(ET.TreeBuilder):
    """Refuses a document type: it may define entities that grow without end or read files."""

    def doctype(self, *_: str | None) -> None:
        """Called for <!DOCTYPE>."""
        raise ValueError("a document type is not expected in KML")


def _parsed(text: str) -> ET.Element:
    parser = ET.XMLParser(target=_NoDoctype())  # noqa: S314 - without a document type no entities
    parser.feed(text)  # a text, whatever encoding its first line names
    root = parser.close()
    assert isinstance(root, ET.Element)  # noqa: S101 - narrows the type: TreeBuilder's result
    if _tag(root) != "kml":
        raise ValueError(f"expected KML, got <{_tag(root)}>")
    return root


def _tag(element: ET.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _from_kml(node: ET.Element, role: AreaRole | None, name: str, ignored: Counter[str]) -> Iterator[Found]:
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


def _kml_role(node: ET.Element) -> AreaRole | None:
    data = node.findall("{*}ExtendedData//{*}Data") + node.findall("{*}ExtendedData//{*}SimpleData")
    words = {d.get("name", ""): (_child_text(d, "value") or d.text or "").strip() for d in data}
    return role_of(words, _child_text(node, "name"))


def _child_text(node: ET.Element, tag: str) -> str:
    child = node.find(f"{{*}}{tag}")
    return "" if child is None else (child.text or "").strip()


def _kml_rings(polygon: ET.Element) -> Iterator[NDArray[np.float64]]:
    outer = polygon.findall("{*}outerBoundaryIs/{*}LinearRing/{*}coordinates")
    inner = polygon.findall("{*}innerBoundaryIs/{*}LinearRing/{*}coordinates")
    if len(outer) != 1:
        raise ValueError(f"expected one outerBoundaryIs in a Polygon, got {len(outer)}")
    for element in (*outer, *inner):
        text = re.sub(r"\s*,\s*", ",", element.text or "")  # some write blanks behind the commas
        tuples = [word.split(",") for word in text.split()]
        if not all(len(numbers) in (2, 3) for numbers in tuples):
            raise ValueError("expected coordinates as longitude,latitude[,altitude], separated by blanks")
        yield np.array([[float(lon), float(lat)] for lon, lat, *_ in tuples]).reshape(-1, 2)
