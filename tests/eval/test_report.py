from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swardmap.config import config_from_dict
from swardmap.eval import charts, gallery
from swardmap.eval.charts import Mark
from swardmap.eval.cost import margin_cost
from swardmap.eval.dataset import DatasetSpec
from swardmap.eval.gallery import LAYERS
from swardmap.eval.look_again import look_again
from swardmap.eval.margin_section import MarginOptions
from swardmap.eval.report import report_html
from swardmap.eval.results import results
from swardmap.eval.run import evaluate, make_plan
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.maps.map_files import write_map
from swardmap.io.sources.folder import write_folder
from tests.browser import browser, serious_faults
from tests.teach.scenes import lane

__all__ = ["browser"]

COMMAND = "swardmap evaluate 'a <script>alert(1)</script> & c' -o out"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    careless = {"min_grass_points": 1}  # so that frames have missed cells
    config = config_from_dict(
        {"geometry": {"enabled": False}, "segmenter": {"name": "colour"}, "grid": careless}
    )
    plan = make_plan(DatasetSpec("analytic:scenes=2,frames=3,width=128"), config)
    records = evaluate(plan, folder / "run", workers=1)
    records[4] = {"index": 4, "error": "rgb/<b>.png is truncated"}
    found = results(plan, records, MarginOptions(0.5, 0.8), COMMAND)
    lawn = OccupancyGrid(GridSpec(0.1, 60, 40), np.ones((40, 60), np.uint8))
    write_map(lawn, folder / "map.yaml")
    found["cost"] = margin_cost(found, folder / "map.yaml", None, 0.5)
    (folder / "report.html").write_text(report_html(plan, found), encoding="utf-8")
    return folder / "report.html"


def test_the_page_stands_alone_and_escapes_what_it_is_told(page: Path) -> None:
    html = page.read_text(encoding="utf-8")
    assert html.count("<script") == 1  # ours, that moves the maps
    assert "&lt;script&gt;alert(1)" in html
    assert "rgb/&lt;b&gt;.png is truncated" in html
    html = html.replace("http://www.w3.org/2000/svg", "")
    for outside in ("http://", "https://", 'src="/', "@import", "url("):
        assert outside not in html
    assert "$" not in html.split("</style>")[1].split("<script>")[0]
    assert html.index("Grow obstacles by") < html.index('<h2 id="budget">')
    assert html.count('class="frame"') == html.count('class="map-box"') == 5
    assert html.index('id="things"') < html.index('id="budget"')
    assert html.count("<details>") == 14


def test_frames_without_any_lawn_have_a_page_too(tmp_path: Path) -> None:
    """A yard or a road: nobody knows where its ground lies, and the page could not be written."""
    yard = (replace(f, labels=np.zeros(f.depth.shape, np.uint8)) for f in lane(n=2))
    write_folder(yard, tmp_path / "yard")
    plan = make_plan(DatasetSpec(str(tmp_path / "yard")), config_from_dict({"segmenter": {"name": "truth"}}))
    found = results(plan, evaluate(plan, tmp_path / "run", workers=1), None, COMMAND)
    assert "heights above the ground that was\nknown to nobody in 2 frames" in report_html(plan, found)


def test_no_folder_of_this_machine_is_told(page: Path, tmp_path: Path) -> None:
    plan = make_plan(DatasetSpec("analytic:scenes=1,frames=1,width=96"))
    found = results(
        plan, [{"index": 0, "error": "gone"}], command="swardmap evaluate /home/me/lawn -o /srv/out"
    )
    found["dataset"] = "/home/me/lawn"
    html = report_html(plan, found)
    assert "/home/me" not in html
    assert "swardmap evaluate lawn -o out" in html
    assert str(page.parent) not in page.read_text(encoding="utf-8")


def test_charts_take_nothing_and_one_value() -> None:
    assert "<svg" in charts.histogram([], [], "x", "y", "empty")
    assert "<svg" in charts.curve([], [], "x", "y", "empty")
    drawn = charts.bars([("a <b>", None, "–"), ("c", 2.0, "2")], "bars", "m", "red")  # noqa: RUF001
    assert drawn.count("<rect") == 1
    assert "a &lt;b&gt;" in drawn
    one = charts.curve([(0.5, 1.0)], [Mark(0.5, "mean", "red")], "x", "y", "one", steps=True)
    assert "NaN" not in one
    assert "nan" not in one


def test_bars_are_as_long_as_their_counts() -> None:
    svg = charts.histogram([(0.0, 0.1, 10), (0.1, 0.2, 5)], [], "x", "y", "h")
    heights = [float(part.split('"')[0]) for part in svg.split('height="')[1:]]
    assert heights[0] == pytest.approx(2 * heights[1])


@pytest.mark.slow
@pytest.mark.parametrize("width", [360, 390, 768, 1280])
def test_in_chromium_it_fits_every_screen_and_asks_for_nothing(page: Path, browser: Any, width: int) -> None:
    tab = browser.new_page(viewport={"width": width, "height": 800}, java_script_enabled=True)
    requests: list[str] = []
    messages: list[str] = []
    tab.on("request", lambda request: requests.append(request.url))
    tab.on("console", lambda message: messages.append(message.text))
    tab.goto(page.as_uri())
    assert [url for url in requests if not url.startswith("data:")] == [page.as_uri()]
    assert messages == []
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert tab.evaluate("[...document.images].every(i => i.complete && i.naturalWidth > 0)")
    assert tab.locator("h1").inner_text().startswith("How far the maps")
    assert tab.locator("svg.chart").count() >= 5
    sizes = "[...document.querySelectorAll('svg.chart')].every(s => s.getBoundingClientRect().height > 60)"
    assert tab.evaluate(sizes)
    small = tab.evaluate("Math.min(...[...document.querySelectorAll('svg.chart text')]"
                         ".map(t => t.getBoundingClientRect().height))")  # fmt: skip
    assert small > 7  # still readable
    broken = """[...document.querySelectorAll('th')].filter(th => {
        const words = th.textContent.split(/\\s+/), range = document.createRange(), text = th.firstChild;
        if (!text) return false;
        let at = 0;
        return words.some(word => { at = text.data.indexOf(word, at); range.setStart(text, at);
            range.setEnd(text, at + word.length); at += word.length;
            return word.length > 0 && range.getClientRects().length > 1 && !word.includes('-'); });
    }).map(th => th.textContent)"""
    assert tab.evaluate(broken) == []  # no header breaks inside a word
    if width >= 390:  # the first table is read without scrolling sideways
        assert tab.locator(".scroll").first.evaluate("e => e.scrollWidth - e.clientWidth") <= 0
    heights = "e => [e.querySelector('.stack').clientHeight, e.querySelector('.map-svg').clientHeight]"
    photo, drawn = tab.locator(".photo-and-map").first.evaluate(heights)
    if width > 704:  # side by side, without a hole under either
        assert drawn == pytest.approx(photo, rel=0.05)
    overlaps = """[...document.querySelectorAll('.map-box')].filter(map => {
        const rows = [...map.querySelectorAll('text')].map(t => t.getBoundingClientRect());
        return rows.some((a, i) => rows.some((b, j) => i < j && a.left < b.right && b.left < a.right
            && a.top + 2 < b.bottom && b.top + 2 < a.bottom));
    }).map(map => map.dataset.map)"""
    assert tab.evaluate(overlaps) == []  # no words on a map lie on others
    tab.locator("summary").first.click()
    assert tab.locator("details[open] table").count() == 1
    tab.close()


@pytest.mark.slow
def test_maps_move_layers_switch_and_links_lead_to_things(page: Path, browser: Any) -> None:
    tab = browser.new_page(viewport={"width": 1100, "height": 900})
    faults: list[str] = []
    tab.on("pageerror", lambda error: faults.append(str(error)))
    tab.goto(page.as_uri())
    for name, *_, first in LAYERS:
        layers, box = f'[data-name="{name}"]', f'[data-layer="{name}"]'
        assert tab.locator(box).is_checked() == first
        for wanted in (not first, first):
            tab.set_checked(box, wanted)
            states = tab.eval_on_selector_all(
                layers,
                "all => all.map(e => (e.getAttribute('display') || getComputedStyle(e).display) != 'none')",
            )
            assert states
            assert set(states) == {wanted}, name
    link = tab.locator("a[data-goto]").first
    name, x, y = (link.get_attribute(f"data-{key}") for key in ("goto", "x", "y"))
    link.click()
    left, top, width, height = map(float, tab.locator(f"#{name}-svg").get_attribute("viewBox").split())
    assert (left + width / 2, top + height / 2) == pytest.approx((float(x), -float(y)), abs=0.01)
    assert tab.locator(f"#{name}").is_visible()
    assert tab.evaluate("location.hash") == f"#{name}"
    before = tab.locator(f"#{name}-svg").get_attribute("viewBox")
    tab.locator(f'[data-map="{name}"] [data-do="in"]').click()
    assert tab.locator(f"#{name}-svg").get_attribute("viewBox") != before
    assert faults == []
    tab.close()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_has_no_serious_fault_of_access(page: Path, browser: Any, scheme: str) -> None:
    tab = browser.new_page(viewport={"width": 390, "height": 800}, color_scheme=scheme)
    tab.goto(page.as_uri())
    assert serious_faults(tab) == []
    tab.close()


def test_frames_of_a_page_are_bounded(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = config_from_dict({"segmenter": {"name": "truth"}})
    plan = make_plan(DatasetSpec("analytic:scenes=1,frames=3,width=96"), config, with_budget=False)
    again = [(i, seen) for i in range(3) if (seen := look_again(plan, i)) is not None]
    assert len(gallery.frame_views(again, 0.1)) == 3
    monkeypatch.setattr(gallery, "MOST_BYTES", 10)
    assert len(gallery.frame_views(again, 0.1)) == 1


@pytest.mark.slow
def test_it_prints(page: Path, browser: Any, tmp_path: Path) -> None:
    tab = browser.new_page()
    tab.goto(page.as_uri())
    tab.emulate_media(media="print")
    assert not tab.locator("nav").is_visible()
    pdf = tab.pdf(path=str(tmp_path / "report.pdf"), format="A4")
    assert pdf[:5] == b"%PDF-"
    assert len(pdf) > 20_000
    tab.close()
