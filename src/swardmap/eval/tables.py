"""Tables 2 to 10 of the paper in its own layout, as Markdown and LaTeX."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from swardmap.eval.confusion import ConfusionMatrix
from swardmap.eval.dataset import dataset_name
from swardmap.eval.frame import split_key
from swardmap.eval.metrics import METRICS, UNDEFINED, interval_text
from swardmap.eval.pages import percent
from swardmap.labels import Role

SCORES = ("accuracy", "f1", "precision", "recall", "specificity")
SCORE_HEADS = ("Accuracy [%]", "F1 [%]", "Precision [%]", "Recall [%]", "Specificity [%]")


@dataclass(frozen=True, slots=True)
class Table:
    """One table.

    Attributes:
        number: of the paper's table it follows; S1 and on are ours.
        caption: what it shows, of which data.
        head: names of the columns.
        rows: cells as text; an empty first cell repeats the one above.
        about: `masks`, or the protocol of the maps; with the number it tells tables apart.
    """

    number: int | str
    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    about: str = "masks"

    @property
    def markdown(self) -> str:
        """The table for Markdown."""
        lines = [" | ".join(cells) for cells in (self.head, ("---",) * len(self.head), *self.rows)]
        return (
            f"**Table {self.number}.** {self.caption}\n\n" + "\n".join(f"| {line} |" for line in lines) + "\n"
        )

    @property
    def latex(self) -> str:
        """The table for LaTeX with the package booktabs."""
        columns = "l" * sum(not h.endswith("]") for h in self.head)
        columns += "r" * (len(self.head) - len(columns))
        body = [" & ".join(map(_escaped, cells)) + r" \\" for cells in self.rows]
        return "\n".join(
            [r"\begin{table}", r"\centering", rf"\caption{{{_escaped(self.caption)}}}",
             rf"\label{{tab:{self.about}-{self.number}}}",
             rf"\begin{{tabular}}{{{columns}}}", r"\toprule", " & ".join(map(_escaped, self.head)) + r" \\",
             r"\midrule", *body, r"\bottomrule", r"\end{tabular}", r"\end{table}", ""]
        )  # fmt: skip


def paper_tables(results: Mapping[str, Any]) -> list[Table]:
    """The tables that the data has the fields for; a table by sequence needs the tag `sequence` or `scene`.

    Args:
        results: from `results.results`.
    """
    if results["masks"]["overall"] is None:
        return []
    masks, maps, data = results["masks"], results["maps"], dataset_name(results["dataset"])
    sequence = next((tag for tag in ("sequence", "scene") if tag in masks["by"]), None)
    tables = []
    if "illumination" in masks["by"]:
        tables.append(_mask_table(2, "Illumination Conditions", masks["by"]["illumination"], data, two=True))
    tables.append(_mask_table(3, None, {"": masks["overall"]}, data, two=True))
    if sequence is not None:
        tables.append(_mask_table(4, sequence.capitalize(), masks["by"][sequence], data, two=True))
        tables.append(_mask_table(5, sequence.capitalize(), masks["by"][sequence], data, two=False))
    for protocol in dict.fromkeys(split_key(key)[0] for key in maps):
        of_protocol = {
            split_key(key)[1]: section for key, section in maps.items() if split_key(key)[0] == protocol
        }
        tables += _map_tables(protocol, of_protocol, sequence, data)
    return tables


def safety_tables(results: Mapping[str, Any]) -> list[Table]:
    """What a safety engineer reads first: all headlines, and those of each sequence or scene.

    Args:
        results: from `results.results`.
    """
    found = results["metrics"]["overall"]
    if found is None:
        return []
    headlines = [m for m in METRICS if m.headline]
    data, unit = dataset_name(results["dataset"]), results["unit"]
    rows = tuple(
        (m.title, m.text(found[m.key]["value"]), f"{found[m.key]['count']} of {found[m.key]['of']}",
         interval_text(found[m.key]) or UNDEFINED)
        for m in headlines
    )  # fmt: skip
    margin = f"margin {results['margin_in_use_m']:g} m"
    head = ("Figure", "Value", "Count", f"95 % by {unit or 'sequence'}")
    tables = [Table("S1", f"What a safety engineer reads first, {data}, {margin}.", head, rows, "safety")]
    shown = [m for m in headlines if not m.key.startswith(("things_5", "things_2", "things_over"))]
    for tag in ("illumination", "scene", "sequence"):
        groups = results["metrics"]["by"].get(tag)
        if groups and len(groups) > 1:
            lines = tuple(
                (_title(name), *(m.text(section[m.key]["value"]).removesuffix(" %") for m in shown))
                for name, section in groups.items()
            )
            heads = (tag.capitalize(), *(f"{_title(m.title)} [%]" for m in shown))
            caption = f"The same by {tag}, {data}, {margin}."
            tables.append(Table(f"S{len(tables) + 1}", caption, heads, lines, "safety"))
    return tables


def _mask_table(number: int, group: str | None, sections: Mapping[str, Any], data: str, two: bool) -> Table:
    model = "grass/obstacle" if two else "grass/obstacle/person"
    by = f" by {group.lower()}" if group else ""
    rows: list[tuple[str, ...]] = []
    for name, section in sections.items():
        matrix = ConfusionMatrix.from_dict(section["matrix"])
        matrix = _two_classes(matrix) if two else matrix
        for i, scores in enumerate(matrix.all_scores()):
            # with two classes both have the overall accuracy, which the paper prints once
            values = [None if two and i and s == "accuracy" else getattr(scores, s) for s in SCORES]
            texts = [
                percent(v) if not (two and i and s == "accuracy") else ""
                for s, v in zip(SCORES, values, strict=True)
            ]
            first = (_title(name) if i == 0 else "",) if group else ()
            rows.append((*first, _title(scores.name), *texts))
    head = ((group,) if group else ()) + ("Class", *SCORE_HEADS)
    return Table(number, f"Segmentation results for {model} model{by}, {data}.", head, tuple(rows))


def _map_tables(
    protocol: str, by_resolution: Mapping[float, Any], sequence: str | None, data: str
) -> list[Table]:
    overall = {f"{r:g}": section["overall"] for r, section in by_resolution.items()}
    where = f"{data}, {protocol} protocol"
    rows = tuple(
        (text, _metres(s["d_min"]["all"]["mean_m"]), _metres(s["d_min"]["all"]["variance_m2"]))
        for text, s in overall.items()
    )
    d_min_heads = ("avg(d_min-obst) [m]", "var(d_min-obst) [m²]")
    tables = [
        _cells_table(
            6,
            "Map Resolution [m]",
            overall,
            f"Obstacle detection results based on map updates, {where}.",
            protocol,
        ),
        Table(
            7,
            f"Summary statistics of d_min-obst, {where}.",
            ("Map Resolution [m]", *d_min_heads),
            rows,
            protocol,
        ),
    ]
    if sequence is None:
        return tables
    for number, resolution_m in ((8, 0.1), (9, 0.05)):
        if resolution_m in by_resolution:
            caption = f"Obstacle detection results at {resolution_m:g} m, {where}."
            groups = by_resolution[resolution_m]["by"][sequence]
            tables.append(_cells_table(number, sequence.capitalize(), groups, caption, protocol))
    lines = []
    for name in next(iter(by_resolution.values()))["by"][sequence]:
        for i, resolution_m in enumerate(sorted(by_resolution, reverse=True)):
            d_min = by_resolution[resolution_m]["by"][sequence][name]["d_min"]["all"]
            first = _title(name) if i == 0 else ""
            lines.append(
                (first, f"{resolution_m:g}", _metres(d_min["mean_m"]), _metres(d_min["variance_m2"]))
            )
    head = (sequence.capitalize(), "Map Resolution [m]", *d_min_heads)
    caption = f"Summary statistics of d_min-obst by {sequence}, {where}."
    return [*tables, Table(10, caption, head, tuple(lines), protocol)]


def _cells_table(number: int, group: str, sections: Mapping[str, Any], caption: str, protocol: str) -> Table:
    rows = [
        (_title(name) if i == 0 else "", _title(scores["name"]), *(percent(scores[s]) for s in SCORES))
        for name, section in sections.items()
        for i, scores in enumerate(section["joined"]["classes"])
    ]
    return Table(number, caption, (group, "Class", *SCORE_HEADS), tuple(rows), protocol)


def _two_classes(matrix: ConfusionMatrix) -> ConfusionMatrix:
    """Persons and all other obstacles as one class, as the paper's first model sees them."""
    free = [n for n, role in zip(matrix.names, matrix.roles, strict=True) if role is Role.FREE]
    other = [n for n in matrix.names if n not in free]
    groups = {name: members for name, members in (("other", other), ("grass", free)) if members}
    return matrix.merged(groups)


def markdown(tables: Sequence[Table]) -> str:
    """All tables, one below the other."""
    return "\n".join(table.markdown for table in tables)


def latex(tables: Sequence[Table]) -> str:
    """All tables, one below the other."""
    return "% needs \\usepackage{booktabs}\n" + "\n".join(table.latex for table in tables)


def _metres(value: float | None) -> str:
    return UNDEFINED if value is None else f"{value:.3f}"


def _title(name: str) -> str:
    return name[:1].upper() + name[1:]


def _escaped(text: str) -> str:
    """Text for LaTeX, with the paper's symbol in place of its name."""
    for plain, safe in (("%", r"\%"), ("&", r"\&"), ("#", r"\#"), ("_", r"\_")):
        text = text.replace(plain, safe)
    text = text.replace(r"d\_min-obst", r"$d_{\min\text{-obst}}$")
    return text.replace("²", "$^2$").replace(UNDEFINED, "--")
