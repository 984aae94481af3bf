"""What `mkdocs build` adds to the pages in docs/: the API by room, and other files that pages link to.

A hook of mkdocs (see mkdocs.yml). Pages link as the repository lies, so that they also work where it is
hosted; here a link out of docs/ becomes one to a copy inside the site. Nothing is fetched when a page is
read, and a page that would is an error.
"""

import ast
import re
from html.parser import HTMLParser
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "swardmap"
LINK = re.compile(r"\]\((?!\w+:|#)([^)#\s]+)(#[^)\s]*)?\)")
SEARCH_FROM_FOLDER = "https://unpkg.com/iframe-worker/shim"
OUR_COPY = "javascripts/iframe-worker.js"
AT_ROOT = ("CONTRIBUTING.md", "CHANGELOG.md")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """List the rooms of the API in the navigation."""
    config.nav.append({"API": [f"api/{room}.md" for room in ["swardmap", *rooms()]]})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the API, and every file outside docs/ that a page links to."""
    for room, text in api_pages().items():
        files.append(File.generated(config, f"api/{room}.md", content=text))
    added = set(AT_ROOT)
    for page in [*Path(config.docs_dir).rglob("*.md"), *(ROOT / name for name in AT_ROOT)]:
        for path, _ in LINK.findall(page.read_text(encoding="utf-8")):
            target = normpath((page.parent.relative_to(ROOT) / path).as_posix())
            if not target.startswith("docs/") and (ROOT / target).is_file():
                added.add(target)
    for name in sorted(added):
        files.append(File.generated(config, name, content=(ROOT / name).read_bytes()))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Turn links that hold in the repository into links that hold in the site."""
    uri = page.file.src_uri
    if uri.startswith("api/"):
        return markdown
    here = PurePosixPath(
        uri if uri in AT_ROOT or not (ROOT / "docs" / uri).is_file() else f"docs/{uri}"
    ).parent

    def moved(match: re.Match[str]) -> str:
        target = normpath((here / match[1]).as_posix()).removeprefix("docs/")
        if target in ("README.md", "."):
            target = "index.md"
        return f"]({relpath(target, PurePosixPath(uri).parent)}{match[2] or ''})"

    return LINK.sub(moved, markdown)


def on_post_build(config: MkDocsConfig) -> None:
    """Refuse a site that fetches anything from elsewhere when it is read."""
    site = Path(config.site_dir)
    for file in site.rglob("*.html"):
        text = file.read_text(encoding="utf-8")
        if SEARCH_FROM_FOLDER in text:
            file.write_text(text := text.replace(SEARCH_FROM_FOLDER, relpath(site / OUR_COPY, file.parent)))
        seen = Assets()
        seen.feed(text)
        if seen.foreign:
            raise PluginError(f"{file.name}: expected only files of the site, found {seen.foreign[0]}")


class Assets(HTMLParser):
    """Collects what a page would fetch from another host."""

    def __init__(self) -> None:
        super().__init__()
        self.foreign: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """Look at one element: links that one follows by hand are no assets."""
        if tag in ("script", "link", "img", "iframe", "source"):
            values = {key: value or "" for key, value in attributes}
            if values.get("rel") != "canonical":
                urls = (values.get("src", ""), values.get("href", ""))
                self.foreign += [url for url in urls if re.match(r"(https?:)?//", url)]


def rooms() -> list[str]:
    """The rooms and single modules of the package, in the order of the design."""
    first = ("types", "geometry", "labels", "grid", "errors", "segmenter", "config", "perception", "mapping")
    found = {p.stem for p in PACKAGE.glob("*.py")} | {p.parent.name for p in PACKAGE.glob("*/__init__.py")}
    found -= {"__init__", "__main__", "cli"}
    return [*(room for room in first if room in found), *sorted(found - set(first))]


def api_pages() -> dict[str, str]:
    """Room -> its page: one directive a module, so that a new module shows by itself."""
    top = "".join(f"* [`{name}`][swardmap.{home}.{name}]\n" for name, home in public_names())
    pages = {"swardmap": f"# swardmap\n\n::: swardmap\n    options: {{members: false}}\n\n{top}"}
    for room in rooms():
        files = sorted((PACKAGE / room).rglob("*.py")) or [PACKAGE / f"{room}.py"]
        names = [".".join(("swardmap", *f.relative_to(PACKAGE).with_suffix("").parts)) for f in files]
        body = "".join(f"::: {name.removesuffix('.__init__')}\n{own_only(name)}\n" for name in names)
        pages[room] = f"# {room}\n\n{body}"
    return pages


def own_only(module: str) -> str:
    """A package's own page shows its own members; its modules have directives of their own."""
    return "    options: {show_submodules: false}\n" if module.endswith(".__init__") else ""


def public_names() -> list[tuple[str, str]]:
    """Names at the top of the package, with their modules."""
    for node in ast.parse((PACKAGE / "__init__.py").read_text()).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "_HOME":
            return sorted(ast.literal_eval(node.value).items())
    raise PluginError("swardmap/__init__.py: expected the table _HOME")
