"""The shells and files of the page: open where there are keys, without other hosts, kept for ever."""

import re
from urllib.parse import urljoin

import pytest

from service.dashboard.routes import PAGES
from service.jobs.keys import Role
from tests.support.keys import make

pytestmark = pytest.mark.any_database

LINK = re.compile(r'(?:href|src)="([^"]*)"')


def files_of(page: str) -> list[str]:
    return [link for link in LINK.findall(page) if link.startswith("static/page/")]


@pytest.mark.parametrize("path", PAGES)
def test_a_shell_and_its_files_are_from_here_and_need_no_key(client, database, path):
    make(database, Role.READ)
    assert client.get("/v1/jobs").status_code == 401
    shell = client.get(path)
    assert shell.headers["Content-Type"].startswith("text/html")
    assert not re.search(r"<style|\sstyle=|\son\w+=|<script>", shell.text)
    assert all(not link.startswith(("http", "//", "/")) for link in LINK.findall(shell.text))
    assert len(files_of(shell.text)) >= 3
    for link in files_of(shell.text):
        answer = client.get(f"/{link}")
        assert answer.status_code == 200, link
        # Modules import each other by names beside them: these are files, too.
        for name in re.findall(r'(?:from|import)\s*\(?"\./([\w.-]+)"', answer.text):
            assert client.get(f"/{link.rsplit('/', 1)[0]}/{name}").status_code == 200, (link, name)


@pytest.mark.parametrize("path", [*PAGES, "/static/page/x/core.js"])
def test_nothing_inline_runs_and_nothing_comes_from_elsewhere(client, path):
    policy = dict(
        part.split(maxsplit=1) for part in client.get(path).headers["Content-Security-Policy"].split("; ")
    )
    assert policy["default-src"] == policy["frame-ancestors"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"


def test_files_are_kept_for_ever_at_the_address_that_pages_link_to(client):
    (link,) = [link for link in files_of(client.get("/").text) if link.endswith("core.js")]
    kept = client.get(f"/{link}")
    assert "immutable" in kept.headers["Cache-Control"]
    assert client.get(f"/{link}", headers={"If-None-Match": kept.headers["ETag"]}).status_code == 304
    other = client.get("/static/page/another/core.js")
    assert other.content == kept.content
    assert other.headers["Cache-Control"] == "no-cache"


def test_plotly_is_that_of_its_wheel(client):
    answer = client.get("/static/page/x/plotly.min.js")
    assert answer.headers["Content-Type"].startswith("text/javascript")
    assert "plotly.js v" in answer.text[:200]


@pytest.mark.parametrize("name", ["none.js", "..%2froutes.py", "__init__.py"])
def test_nothing_else_is_served(client, name):
    assert client.get(f"/static/page/x/{name}").status_code == 404


PAGE = {"Accept": "text/html,application/xhtml+xml,*/*;q=0.8"}


@pytest.mark.parametrize("path", ["/nowhere", "/solutions/019f0000-0000-7000-8000-000000000001", "/a/b/"])
def test_an_unknown_address_has_a_page_whose_links_hold_wherever_it_is(client, path):
    answer = client.get(path, headers=PAGE)
    assert (answer.status_code, answer.headers["Content-Type"]) == (404, "text/html; charset=utf-8")
    assert "There is no such page" in answer.text
    assert answer.headers["Content-Security-Policy"].startswith("default-src 'none'")
    linked = {
        urljoin(path, link) for link in LINK.findall(answer.text) if not link.startswith(("data:", "#"))
    }
    assert {path for path, page in PAGES.items() if not page.below} <= linked
    assert all(client.get(link).status_code == 200 for link in linked)


def test_without_a_key_nobody_learns_whether_a_path_exists(client, database):
    make(database, Role.READ)
    for path in ("/nowhere", "/v1x/solutions"):
        locked = client.get(path, headers=PAGE)
        assert locked.status_code == 401
        assert "There is no such page" in locked.text


def test_programs_and_the_api_get_problem_documents(client):
    for path, headers in (("/nowhere", {}), ("/v1/nowhere", PAGE), ("/v1/solutions/x", PAGE)):
        answer = client.get(path, headers=headers)
        assert (answer.status_code, answer.headers["Content-Type"]) == (404, "application/problem+json")
    assert client.post("/nowhere", headers=PAGE).headers["Content-Type"] == "application/problem+json"
