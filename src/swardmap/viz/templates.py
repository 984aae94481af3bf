"""HTML from the templates in data/report; everything that is told is escaped there."""

from collections.abc import Callable, Mapping
from typing import Any

from swardmap import __version__


def render(template: str, filters: Mapping[str, Callable[..., Any]] | None = None, **context: Any) -> str:
    """A page from one of the templates; `base.html` is the frame of all of them, and tells the version.

    Args:
        template: file in data/report.
        filters: of the template, by name.
        context: its names, `title` and `command` among them; only `markupsafe.Markup` is taken as HTML.
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
    return environment.get_template(template).render(context, version=__version__)
