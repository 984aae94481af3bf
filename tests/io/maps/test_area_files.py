"""Work areas as files: GeoJSON and KML say the same; what is damaged or ambiguous gives one clear error."""

import contextlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.config import AreaConfig
from swardmap.errors import InputError
from swardmap.grid import GridSpec
from swardmap.io.maps.area_files import MAX_BYTES, read_area, read_polygons
from swardmap.mapping.geodesy import Projection
from swardmap.mapping.work_area import AreaRole

pytest.importorskip("pyproj")
LAT, LON = 52.4012, 16.9123
LAWN = [[16.9120, 52.4010], [16.9130, 52.4010], [16.9130, 52.4015], [16.9120, 52.4015], [16.9120, 52.4010]]
POND = [[16.9122, 52.4011], [16.9122, 52.4012], [16.9124, 52.4012], [16.9124, 52.4011], [16.9122, 52.4011]]
BED = [[16.9126, 52.4012], [16.9128, 52.4012], [16.9127, 52.4013], [16.9126, 52.4012]]


def feature(coordinates: Any, kind: str = "Polygon", **properties: Any) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties or None, "geometry": geometry}


def collection(*features: Any, **more: Any) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": list(features), **more}


GARDEN = collection(
    feature([LAWN, POND], role="boundary", name="lawn"), feature([BED], role="exclusion", name="bed")
)


def kml_ring(ring: list[list[float]]) -> str:
    text = "\n".join(f"{lon},{lat},0" for lon, lat in ring)
    return f"<LinearRing><coordinates>\n{text}\n</coordinates></LinearRing>"


def kml_polygon(*rings: list[list[float]]) -> str:
    inner = "".join(f"<innerBoundaryIs>{kml_ring(r)}</innerBoundaryIs>" for r in rings[1:])
    return f"<Polygon><outerBoundaryIs>{kml_ring(rings[0])}</outerBoundaryIs>{inner}</Polygon>"


def kml(body: str) -> str:
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
        f"<name>garden</name>{body}</Document></kml>"
    )


def role_data(role: str) -> str:
    return f'<ExtendedData><Data name="role"><value>{role}</value></Data></ExtendedData>'


def placemark(name: str, body: str, role: str = "") -> str:
    return f"<Placemark><name>{name}</name>{role_data(role) if role else ''}{body}</Placemark>"


GARDEN_KML = kml(
    placemark("lawn", kml_polygon(LAWN, POND), "boundary") + placemark("bed", kml_polygon(BED), "exclusion")
)


def written(tmp_path: Path, content: Any) -> Path:
    file = tmp_path / "area"
    file.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return file


def config(file: Path) -> AreaConfig:
    return AreaConfig(file=str(file), datum_lat=LAT, datum_lon=LON)


def test_geojson_and_kml_give_the_same_cells(tmp_path: Path) -> None:
    spec = GridSpec(0.25, 320, 280, (-40.0, -40.0))
    areas = [read_area(config(written(tmp_path, content))) for content in (GARDEN, GARDEN_KML)]
    one, two = areas
    assert one is not None
    assert two is not None
    for a, b in zip(one.polygons, two.polygons, strict=True):
        assert (a.role, a.name) == (b.role, b.name)
        for p, q in zip(a.rings, b.rings, strict=True):
            np.testing.assert_array_equal(p, q)
    assert [p.name for p in one.polygons] == ["lawn", "bed"]
    np.testing.assert_array_equal(one.keep_out(spec), two.keep_out(spec))
    at = Projection(LAT, LON).to_map([(16.9125, 52.40135), (16.9123, 52.40115), (16.9127, 52.40125)])
    kept = [bool(one.keep_out(spec)[iy, ix]) for ix, iy in spec.cell_of(at)]
    assert kept == [False, True, True]  # lawn, pond, bed


@pytest.mark.parametrize(
    "content",
    [
        {"type": "Polygon", "coordinates": [LAWN]},
        {"type": "MultiPolygon", "coordinates": [[LAWN]]},
        feature([LAWN]),
        collection(feature([LAWN])),
        {"type": "Feature", "properties": {}, "geometry": {
            "type": "GeometryCollection", "geometries": [{"type": "Polygon", "coordinates": [LAWN]}]}},
        collection(feature([LAWN]), crs={"properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}),
        {"type": "Polygon", "coordinates": [[[*p, 87.5] for p in LAWN]]},
        {"type": "Polygon", "coordinates": [LAWN[:-1]]},
        "\ufeff" + json.dumps({"type": "Polygon", "coordinates": [LAWN]}),
        kml(kml_polygon(LAWN)),
        kml(placemark("x", f"<MultiGeometry>{kml_polygon(LAWN)}</MultiGeometry>")),
        kml(f"<Folder><name>Boundary of all</name>{placemark('x', kml_polygon(LAWN))}</Folder>"),
        kml(placemark("x", kml_polygon(LAWN))).replace(' xmlns="http://www.opengis.net/kml/2.2"', ""),
    ],
)  # fmt: skip
def test_one_boundary_in_many_spellings(content: Any, tmp_path: Path) -> None:
    polygons, ignored = read_polygons(written(tmp_path, content))
    assert [(p.role, len(p.rings)) for p in polygons] == [(AreaRole.BOUNDARY, 1)]
    np.testing.assert_allclose(np.sort(polygons[0].rings[0], axis=0), np.sort(LAWN[:-1], axis=0))
    assert ignored == {}


def test_roles_in_kml_come_from_data_or_the_first_word_of_a_name(tmp_path: Path) -> None:
    simple = (
        '<ExtendedData><SchemaData><SimpleData name="role">exclusion</SimpleData></SchemaData></ExtendedData>'
    )
    body = (
        placemark("boundary: front", kml_polygon(LAWN))
        + f"<Placemark><name>bed</name>{simple}{kml_polygon(BED)}</Placemark>"
        + f"<Folder><name>Exclusion zones</name>{placemark('pond', kml_polygon(POND))}</Folder>"
    )
    polygons, _ = read_polygons(written(tmp_path, kml(body)))
    assert [p.role for p in polygons] == [AreaRole.BOUNDARY, AreaRole.EXCLUSION, AreaRole.EXCLUSION]


def test_what_has_no_area_is_counted(tmp_path: Path) -> None:
    extra = feature(LAWN[0], kind="Point"), feature(LAWN, kind="LineString"), {**feature(0), "geometry": None}
    polygons, ignored = read_polygons(written(tmp_path, collection(*GARDEN["features"], *extra)))
    assert len(polygons) == 2
    assert ignored == {"Point": 1, "LineString": 1, "feature without geometry": 1}
    body = placemark("dock", "<Point><coordinates>1,2</coordinates></Point>")
    assert read_polygons(written(tmp_path, kml(kml_polygon(LAWN) + body)))[1] == {"Point": 1}


ENTITIES = (
    '<?xml version="1.0"?><!DOCTYPE kml [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    "<kml><Document><name>&b;</name></Document></kml>"
)
BROKEN: list[tuple[Any, str]] = [
    ("", "expected GeoJSON or KML"),
    ("hello", "expected GeoJSON or KML"),
    ("PK\x03\x04", "KMZ"),
    ("{", "Expecting"),
    ("{}", "lacks 'type'"),
    ("[" * 100_000, "expected GeoJSON"),
    ('{"a":' * 100_000, "recursion"),
    ('{"type": "Polygon", "coordinates": [[[NaN, 1], [2, 3], [4, 5]]]}', "finite"),
    ('{"type": "Polygon", "coordinates": [[[1e999, 1], [2, 3], [4, 5]]]}', "finite"),
    ({"type": "Polygon", "coordinates": [[[10**400, 1], [2, 3], [4, 5]]]}, "too large"),
    ({"type": "Polygon", "coordinates": []}, "without rings"),
    ({"type": "Polygon", "coordinates": [[["16.9", "52.4"]]]}, "as numbers"),
    ({"type": "Polygon", "coordinates": [[[1], [2], [3]]]}, "positions"),
    ({"type": "Polygon", "coordinates": [LAWN[:2]]}, "three corners"),
    ({"type": "Polygon", "coordinates": [[LAWN[i] for i in (0, 2, 1, 3)]]}, "crosses itself"),
    ({"type": "LineString", "coordinates": LAWN}, "at least one polygon, got 1 x LineString"),
    (collection(), "at least one polygon, got nothing"),
    (collection("lawn"), "indices"),
    (collection(feature([LAWN], role="flower bed")), "the role boundary or exclusion, got 'flower bed'"),
    (collection(feature([LAWN], role=3)), "role to be a word"),
    (collection(feature([LAWN], role="boundary"), feature([BED], name="bed")), "'bed' has none"),
    (collection(feature(LAWN, kind="LineString", role="boundary")), "draw it as a polygon"),
    (collection(feature([LAWN]), crs={"properties": {"name": "EPSG:2180"}}), "EPSG:2180"),
    ({"type": "Polygon", "coordinates": [[p[::-1] for p in LAWN]]}, "more than 20 km"),
    ({"type": "Polygon", "coordinates": [[[p[0], 95] for p in LAWN[:2]] + [LAWN[2]]]}, "latitude -90"),
    ("<html></html>", "expected KML, got <html>"),
    ("<kml><Document>", "no element found"),
    (ENTITIES, "document type"),
    (kml(""), "at least one polygon"),
    (kml("<Polygon></Polygon>"), "one outerBoundaryIs"),
    (kml(kml_polygon(LAWN).replace(",0", ",0,0,0")), "longitude,latitude"),
    (kml(kml_polygon(LAWN).replace(",0", ",x")), ""),
    (kml(kml_polygon(LAWN).replace("16.9120", "east").replace("16.912,", "east,")), "east"),
    (kml(placemark("boundary", kml_ring(LAWN))), "expected a polygon for the role boundary"),
    ("<kml>" * 5000 + "</kml>" * 5000, ""),
]


@pytest.mark.parametrize(("content", "words"), BROKEN)
def test_a_broken_file_gives_one_clear_error(content: Any, words: str, tmp_path: Path) -> None:
    file = written(tmp_path, content)
    if content == kml(kml_polygon(LAWN).replace(",0", ",x")):
        assert len(read_polygons(file)[0]) == 1  # an altitude is not looked at
        return
    with pytest.raises(InputError) as caught:
        read_area(config(file))
    assert words in str(caught.value)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_a_file_that_is_missing_or_too_large_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        read_polygons(tmp_path / "nowhere")
    large = tmp_path / "large.json"
    with large.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(InputError, match="at most"):
        read_polygons(large)
    assert read_area(AreaConfig()) is None


WHOLE = (json.dumps(GARDEN).encode(), GARDEN_KML.encode())


@given(whole=st.sampled_from(WHOLE), noise=st.binary(max_size=100), place=st.floats(0, 1))
def test_damage_never_escapes_as_another_error(
    tmp_path_factory: pytest.TempPathFactory, whole: bytes, noise: bytes, place: float
) -> None:
    file, at = tmp_path_factory.getbasetemp() / "damaged", round(place * len(whole))
    file.write_bytes(whole[:at] + noise + whole[at + len(noise) :])
    with contextlib.suppress(InputError):
        polygons, _ = read_polygons(file)
        assert all(len(ring) >= 3 for polygon in polygons for ring in polygon.rings)


NAMES = ("boundary lawn", "Exclusion pond")
SPELLINGS: list[tuple[dict[str, str], dict[str, str]]] = [
    ({"role": "boundary"}, {"role": "exclusion"}),
    ({"Role": "Boundary"}, {"ROLE": " EXCLUSION "}),
    ({"type": "operation"}, {"type": "exclusion"}),  # OpenMowerNext's map.geojson
    ({"Name": "Zone 1", "Type": "Inclusive", "Action": "None"}, {"Name": "Zone 2", "Type": "Exclusive"}),
    ({"Kind": "Mowing Area"}, {"KIND": "No-Go"}),
    ({"name": NAMES[0]}, {"name": NAMES[1]}),  # togeojson of a KML
    ({"Name": NAMES[0], "description": ""}, {"Name": NAMES[1], "description": ""}),  # ogr2ogr
    ({"Name": "Perimeter", "type": "Polygon"}, {"Name": "keep-out: pond", "type": ""}),
]


@pytest.mark.parametrize(("lawn", "pond"), SPELLINGS)
def test_a_role_is_found_however_it_is_written(
    lawn: dict[str, str], pond: dict[str, str], tmp_path: Path
) -> None:
    polygons, _ = read_polygons(
        written(tmp_path, collection(feature([LAWN], **lawn), feature([POND], **pond)))
    )
    assert [p.role for p in polygons] == [AreaRole.BOUNDARY, AreaRole.EXCLUSION]


@pytest.mark.parametrize(
    ("features", "words"),
    [
        ([feature([LAWN]), feature([POND])], "'feature 1' lies wholly inside 'feature 0'"),
        ([feature([POND], name="pond"), feature([LAWN], name="lawn")], "'pond' lies wholly inside 'lawn'"),
        (
            [feature([LAWN], type="lawn"), feature([POND], type="pond")],
            "is 'lawn' a boundary or an exclusion",
        ),
        ([feature([LAWN], role="boundary", type="exclusion")], "role says boundary, type says exclusion"),
    ],
)
def test_what_may_be_a_pond_is_asked_for(features: list[Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        read_polygons(written(tmp_path, collection(*features)))


def test_boundaries_that_are_named_so_may_lie_in_each_other(tmp_path: Path) -> None:
    both = collection(feature([LAWN], role="boundary"), feature([POND], role="boundary"))
    assert len(read_polygons(written(tmp_path, both))[0]) == 2
    apart = collection(feature([LAWN]), feature([[[lon + 0.01, lat] for lon, lat in LAWN]]))
    assert len(read_polygons(written(tmp_path, apart))[0]) == 2


@pytest.mark.parametrize("separator", ["", "\x1e"])
def test_a_feature_a_line_is_a_collection(separator: str, tmp_path: Path) -> None:
    lines = "".join(f"{separator}{json.dumps(f)}\n" for f in GARDEN["features"])
    assert [p.name for p in read_polygons(written(tmp_path, lines))[0]] == ["lawn", "bed"]


@pytest.mark.parametrize("declared", ["UTF-8", "UTF-16"])
def test_kml_in_utf_16_and_with_blanks_behind_commas(declared: str, tmp_path: Path) -> None:
    file = tmp_path / "area.kml"
    text = GARDEN_KML.replace('encoding="UTF-8"', f'encoding="{declared}"').replace(",", ", ")
    for encoding in ("utf-16", "utf-8"):
        file.write_bytes(text.encode(encoding))
        polygons, _ = read_polygons(file)
        assert [p.role for p in polygons] == [AreaRole.BOUNDARY, AreaRole.EXCLUSION]
        np.testing.assert_allclose(np.sort(polygons[1].rings[0], axis=0), np.sort(BED[:-1], axis=0))
