"""Hooks of MkDocs while it builds the pages: pages that are made of other things, formulas, links.

The references are made from the OpenAPI document, the commands and the client themselves, the tutorials from
notebooks, which are executed if EXECUTE_NOTEBOOKS is set. Formulas between dollar signs become MathML, which
browsers draw without a library.
"""

import json
import os
import re
from html import unescape
from pathlib import Path, PurePosixPath

from client_reference import client_page
from command_reference import commands_page
from http_reference import documents_page, http_page
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from notebooks import tutorial

DOCS = Path(__file__).parents[1]
TOP = DOCS.parent
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((\.\./[^)\s]*)\)")
NOTEBOOK = re.compile(r"\]\(((?:\.\./)?tutorials/[\w-]+)\.ipynb\)")
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
NUMBER = re.compile(r"\\tag\{(\w+)\}")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put every decision into the menu."""
    decisions = [
        {path.read_text().splitlines()[0].lstrip("# "): f"adr/{path.name}"}
        for path in sorted((DOCS / "adr").glob("*.md"))
    ]
    config.nav = _with_decisions(config.nav, decisions)
    return config


def _with_decisions(entry: object, decisions: list[dict[str, str]]) -> object:
    if isinstance(entry, list):
        return [_with_decisions(part, decisions) for part in entry]
    if isinstance(entry, dict):
        return {
            name: decisions if part == "adr" else _with_decisions(part, decisions)
            for name, part in entry.items()
        }
    return entry


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made of other things."""
    api = json.loads((DOCS / "openapi.json").read_text())
    made = {
        "reference/http.md": http_page(api),
        "reference/documents.md": documents_page(api),
        "reference/commands.md": commands_page(),
        "reference/client.md": client_page(),
    }
    for name, content in made.items():
        files.append(File.generated(config, name, content=content))
    for path in sorted((DOCS / "tutorials").glob("*.ipynb")):
        page = tutorial(path, is_executed=bool(os.environ.get("EXECUTE_NOTEBOOKS")))
        files.append(File.generated(config, f"tutorials/{path.stem}.md", content=page.markdown))
        for name, picture in page.pictures.items():
            files.append(File.generated(config, f"tutorials/{name}", content=picture))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Leave only the words of links to folders, and to files that are not among the pages.

    Links to notebooks lead to their pages.
    """
    folder = PurePosixPath("docs", page.file.src_uri).parent

    def said(link: re.Match[str]) -> str:
        target = (TOP / folder / link[2].partition("#")[0]).resolve()
        return link[0] if target.suffix and target.is_relative_to(DOCS) else link[1]

    markdown = NOTEBOOK.sub(r"](\1.md)", LINK.sub(said, markdown))
    return markdown.replace("](adr/)", "](adr/0001-pure-mathematics.md)")


def on_page_content(html: str, **_: object) -> str:
    """Write formulas as MathML."""

    def drawn(formula: re.Match[str]) -> str:
        text, is_block = unescape(formula[2]), formula[1] == "div"
        number = NUMBER.search(text)
        mathml = convert(NUMBER.sub("", text), display="block" if is_block else "inline")
        return f'<div class="formula">{mathml}<span>({number[1]})</span></div>' if number else mathml

    return FORMULA.sub(drawn, html)
