"""HTML from the templates in data/report; everything that is told is escaped there."""

from collections.abc import Callable, Mapping
from typing import Any


def render(template: str, filters: Mapping[str, Callable[..., Any]] | None = None, **context: Any) -> str:
    """A page from one of the templates.

    Args:
        template: file in data/report.
        filters: of the template, by name.
        context: its names; only what is `markupsafe.Markup` is taken as HTML.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("swardmap", "data/report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(filters or {})
    return environment.get_template(template).render(context)
