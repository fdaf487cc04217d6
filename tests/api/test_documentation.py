"""The commands of the documentation give something when they are sent, one after the other, to a service."""

import json
import re
import shlex
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlencode

import pytest

from service.app import create_app
from service.jobs.keys import Role
from service.jobs.records import Claim, JobKind, Solved
from service.settings import Settings
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from tests.support.api import TestClient
from tests.support.keys import make
from tests.support.waiting import wait_until
from workers.process.tasks import draw_atlas, solve_problem
from workers.sweeping.chunk import compute_chunk

TOP = Path(__file__).parents[2]
KEY = "plh_YoDFXD8K_…"


@dataclass
class Request:
    """What a curl command sends."""

    url: str = ""
    method: str | None = None
    headers: dict[str, str] = field(default_factory=dict)
    data: list[str] = field(default_factory=list)
    is_query: bool = False


def read_curl(words: list[str]) -> Request:
    """Return what a command sends; options that are not known here are no option of the documentation."""
    request = Request()
    left = iter(words)
    assert next(left) == "curl"
    for word in left:
        match word:
            case "-s":
                pass
            case "-G":
                request.is_query = True
            case "-X":
                request.method = next(left)
            case "-H":
                name, _, value = next(left).partition(": ")
                request.headers[name] = value
            case "-d":
                request.data.append(next(left))
            case "--data-urlencode":
                name, _, value = next(left).partition("=")
                request.data.append(urlencode({name: value}))
            case _:
                assert word.startswith("http://127.0.0.1:8000/"), f"{word} is no option that is known here"
                request.url = word
    return request


def commands(page: str) -> Iterator[list[str]]:
    """Yield the words of each curl command in blocks of code and in sentences."""
    lines = iter(page.splitlines())
    for line in lines:
        for quoted in re.findall(r"`(curl [^`]*)`", line):
            yield shlex.split(quoted)
        if not line.startswith("curl "):
            continue
        text = line
        while True:
            try:
                words = shlex.split(text.replace("\\\n", " "), comments=True)
            except ValueError:  # a quotation or a line goes on
                text += "\n" + next(lines)
                continue
            break
        yield words


def send(client: TestClient, request: Request, known: dict[str, str]):
    url = re.sub(r"\bID\b", known.get("id", "ID"), request.url.removeprefix("http://127.0.0.1:8000"))
    headers = {
        name: value.replace(KEY, known.get("key", KEY)).encode() for name, value in request.headers.items()
    }
    if request.is_query:
        assert "?" not in url
        return client.get(f"{url}?{'&'.join(request.data)}", headers=headers)
    content = "&".join(request.data) or None
    return client.request(
        request.method or ("POST" if content else "GET"), url, content=content, headers=headers
    )


def work(jobs: JobStore, claim: Claim) -> None:
    """Do what a worker does."""
    if claim.kind is JobKind.CHUNK:
        assert jobs.finish(claim, compute_chunk(json.dumps(claim.payload)))[0]
        return
    if claim.kind is JobKind.ATLAS:
        assert jobs.finish(claim, draw_atlas(json.dumps(claim.payload)))[0]
        return
    outcome = solve_problem(json.dumps(claim.payload), claim.windows, claim.audited)
    assert isinstance(outcome, Solved), outcome
    assert jobs.finish(claim, outcome)[0]


@contextmanager
def worker(jobs: JobStore) -> Iterator[None]:
    """Do jobs as they come, and of each sweep the first points alone."""
    stop, sweeps = threading.Event(), set[str | None]()

    def run() -> None:
        while not stop.is_set():
            claim = jobs.claim("reader", lease_seconds=600.0)
            if claim is None or claim.sweep_id in sweeps:
                stop.wait(0.02)
                continue
            sweeps.update({claim.sweep_id} - {None})
            work(jobs, claim)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.fixture
def client(sqlite_url, verdicts) -> Iterator[TestClient]:
    settings = Settings(database_url=sqlite_url, verdict_seconds=60.0)
    with TestClient(create_app(settings, sandbox=verdicts)) as client:
        yield client


def is_something(response) -> bool:
    """Tell whether an answer has more than its form: a list that is empty is none."""
    match response.headers["content-type"].partition(";")[0]:
        case "application/json":
            document = response.json()
            return bool(document.get("items", True)) and all(document.get("columns", {"t": True}).values())
        case "text/csv":
            return len(response.text.splitlines()) > 1
        case _:
            return bool(response.content)


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("README.md", 3),
        ("docs/index.md", 4),
        ("docs/sweeps.md", 6),
        ("docs/formulas.md", 1),
        ("docs/atlas.md", 3),
        ("docs/queries.md", 8),
        ("docs/start.md", 4),
        ("docs/trust.md", 3),
        ("docs/how-to/accuracy.md", 1),
        ("docs/how-to/family.md", 1),
        ("docs/how-to/sweeps.md", 3),
    ],
)
def test_each_command_gives_something(client, sqlite_url, name, least):
    database = Database(sqlite_url)
    sent = list(commands((TOP / name).read_text(encoding="utf-8")))
    assert len(sent) >= least
    known: dict[str, str] = {}
    with worker(JobStore(database)):
        for words in sent:
            response = send(client, read_curl(words), known)
            assert response.is_success, (shlex.join(words), response.text)
            assert is_something(response), (shlex.join(words), response.text)
            document = response.json() if response.headers["content-type"] == "application/json" else {}
            if "document" in document:
                known["id"] = document["id"]
                # Whoever types the next command sees the first points; the test does not wait for more.
                wait_until(lambda: client.get(f"/v1/sweeps/{known['id']}").json()["done"] > 0)
            elif made := document.get("solution") or document.get("atlas"):
                known["id"] = made
    database.close()


def test_the_key_in_the_documentation_is_sent_as_keys_are(client, sqlite_url):
    database = Database(sqlite_url)
    _, shown = make(database, Role.READ)
    database.close()
    known = {"key": shown["Authorization"].removeprefix("Bearer ")}
    requests = [read_curl(words) for words in commands((TOP / "docs/keys.md").read_text(encoding="utf-8"))]
    assert requests
    for request in requests:
        assert send(client, request, {}).status_code == 401
        assert send(client, request, known).status_code == 200


def test_no_other_page_has_commands_that_nobody_runs():
    pages = [path for path in (TOP / "docs").rglob("*.md") if any(commands(path.read_text(encoding="utf-8")))]
    assert {str(path.relative_to(TOP / "docs")) for path in pages} == {
        "atlas.md",
        "formulas.md",
        "how-to/accuracy.md",
        "how-to/family.md",
        "how-to/sweeps.md",
        "index.md",
        "keys.md",
        "queries.md",
        "start.md",
        "sweeps.md",
        "trust.md",
    }
