"""The documentation as pages: complete, without a dead link, and nothing of it from another host."""

import json
import logging
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config
from mkdocs.utils import CountHandler

import polhode as ph
from polhode.clients import Operations
from polhode.jobs import Job
from polhode.listings import Listing
from polhode.motions import Motion
from polhode.studies import Judgement, Questions
from polhode.sweeps import Sweep

TOP = Path(__file__).parents[2]
LOADED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}
"""Elements with which a browser loads something by itself."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory, monkeypatch_module):
    """Build all pages as ``make docs`` does; a warning is an error."""
    monkeypatch_module.setenv("NO_MKDOCS_2_WARNING", "1")
    folder = tmp_path_factory.mktemp("pages")
    warnings = CountHandler()
    warnings.setLevel(logging.WARNING)
    logging.getLogger("mkdocs").addHandler(warnings)
    build(load_config(str(TOP / "docs" / "site" / "mkdocs.yml"), site_dir=str(folder)))
    logging.getLogger("mkdocs").removeHandler(warnings)
    assert not warnings.get_counts()
    return folder


@pytest.fixture(scope="module")
def monkeypatch_module():
    with pytest.MonkeyPatch.context() as patch:
        yield patch


class Loads(HTMLParser):
    """What a page makes a browser load."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if (address := given.get(LOADED.get(tag, ""))) and given.get("rel") not in (
            "canonical",
            "next",
            "prev",
        ):
            self.addresses.append(address)


def test_every_page_of_the_folder_is_a_page(pages):
    for source in (TOP / "docs").rglob("*.md"):
        page = source.relative_to(TOP / "docs").with_suffix(".html")
        assert (pages / page).exists(), page


def test_no_page_loads_anything_from_another_host(pages):
    for page in pages.rglob("*.html"):
        parser = Loads()
        parser.feed(page.read_text())
        assert parser.addresses
        assert [address for address in parser.addresses if re.match(r"(\w+:)?//", address)] == []


def test_formulas_are_mathml(pages):
    theorem = (pages / "theorem.html").read_text()
    assert theorem.count("<math") > 20
    for page in pages.rglob("*.html"):
        assert 'class="arithmatex"' not in page.read_text(), page


def test_every_operation_and_every_document_has_its_place(pages):
    api = json.loads((TOP / "docs" / "openapi.json").read_text())
    resources = (pages / "reference" / "http.html").read_text()
    for path, operations in api["paths"].items():
        for method in operations:
            assert f"{method.upper()} {path}<" in resources
    documents = (pages / "reference" / "documents.html").read_text()
    for name in api["components"]["schemas"]:
        assert f'id="{name.lower()}"' in documents


def test_every_command_has_its_place(pages):
    commands = (pages / "reference" / "commands.html").read_text()
    for words in ("serve", "worker", "validate", "solve", "sweep", "keys create", "doctor", "calibrate"):
        assert f"polhode {words}<" in commands
    assert "--database-url" in commands


def test_every_name_of_the_client_has_its_place(pages):
    reference = (pages / "reference" / "client.html").read_text()
    for name in ph.__all__:
        if name not in ("Client", "AsyncClient"):  # whose methods have places of their own
            assert re.search(rf">(ph\.)?{name}(\(\))?<", reference), name
    public = [
        name
        for kind in (Operations, Questions, Motion, Sweep, Job, Listing, Judgement)
        for name in vars(kind)
        if not name.startswith("_") and name != "document"  # an attribute, described in the text
    ]
    assert len(public) > 40
    for name in public:
        assert re.search(rf"<h3[^>]*>{name}(\(\))?<", reference), name
