"""The page at /docs: complete without other hosts, open where there are keys."""

import re
from html.parser import HTMLParser

import pytest

from service.jobs.keys import Role
from tests.support.keys import make

pytestmark = pytest.mark.any_database

LINKS = {"href", "src"}


class Links(HTMLParser):
    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.inline: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.found += [value for name, value in attributes if name in LINKS]
        if (tag == "script" and "src" not in given) or tag == "style":
            self.inline.append(tag)
        self.inline += [name for name in given if name.startswith("on") or name == "style"]


def policy(response) -> dict[str, list[str]]:
    parts = (part.split() for part in response.headers["Content-Security-Policy"].split(";"))
    return {name: sources for name, *sources in parts}


@pytest.mark.parametrize("with_keys", [False, True])
def test_the_page_has_all_its_files_from_here_and_needs_no_key(client, database, with_keys):
    if with_keys:
        make(database, Role.READ)
        assert client.get("/v1/jobs").status_code == 401
    page = client.get("/docs")
    assert page.headers["Content-Type"].startswith("text/html")
    links = Links(page.text)
    assert len(links.found) >= 5
    assert links.inline == []  # which the policy would not let run
    for link in links.found:
        assert re.fullmatch(r"(docs/)?[\w.-]+", link), f"{link} is not on this host"
        answer = client.get(f"/{link}")
        assert answer.status_code == 200
        assert answer.content
    script = client.get("/docs/start.js").text
    assert 'url: "openapi.json"' in script
    assert "http" not in script


@pytest.mark.parametrize(
    "path", ["/docs", "/docs/start.js", "/docs/swagger-ui.css", "/docs/swagger-ui-bundle.js"]
)
def test_the_policy_lets_nothing_in_from_elsewhere(client, path):
    response = client.get(path)
    allowed = policy(response)
    assert allowed.pop("img-src") == ["'self'", "data:", "blob:"]
    assert {source for sources in allowed.values() for source in sources} == {"'self'", "'none'"}
    assert allowed["default-src"] == allowed["frame-ancestors"] == ["'none'"]
    assert response.headers["X-Content-Type-Options"] == "nosniff"


@pytest.mark.parametrize(
    "path", ["/redoc", "/docs/oauth2-redirect", "/docs/..%2fdocs_page.py", "/docs/__init__.py"]
)
def test_nothing_else_is_there(client, path):
    assert client.get(path).status_code == 404


def test_the_document_says_how_a_key_is_sent(client):
    (scheme,) = client.get("/openapi.json").json()["components"]["securitySchemes"].values()
    assert (scheme["type"], scheme["scheme"]) == ("http", "bearer")
