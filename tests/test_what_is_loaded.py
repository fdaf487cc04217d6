"""What a command loads before it answers, and what the service loads before its first request.

Every test asks a fresh interpreter, since this one has loaded everything.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.databases import copy_of

ROOT = Path(__file__).parents[1]

SOLVERS = {"scipy", "sympy", "mpmath", "numba", "llvmlite", "heyoka"}
ARRAYS = {"numpy", "flint", "pyarrow", "zstandard"}
STORE = {"sqlalchemy", "alembic", "psycopg"}
WEB = {"fastapi", "starlette", "uvicorn"}
REST = {"rich", "pebble", "matplotlib"}
EVERYTHING = SOLVERS | ARRAYS | STORE | WEB | REST

COMMAND = """
import atexit, importlib, os, sys
entry, *sys.argv[1:] = sys.argv[1:]
atexit.register(lambda: print("loaded", *sorted({name.partition(".")[0] for name in sys.modules})))
os.execve = lambda *_: sys.exit(0)  # a command that becomes a worker has done its part by then
sys.exit(importlib.import_module(entry).main())
"""


def loaded_by(entry, *arguments, folder):
    """Return the exit code of a command, and the names of the top-level packages it has loaded."""
    result = subprocess.run(
        [sys.executable, "-c", COMMAND, entry, *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    *_, last = result.stdout.splitlines()
    word, *names = last.split()
    assert word == "loaded", result.stderr
    return result.returncode, set(names)


@pytest.mark.parametrize(("arguments", "code"), [(["--help"], 0), (["--version"], 0), ([], 2)], ids=str)
def test_help_and_version_load_not_even_what_reads_options(arguments, code, tmp_path):
    assert_free(loaded_by("service.cli.main", *arguments, folder=tmp_path), code, EVERYTHING | {"pydantic"})


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["serve", "--help"], 0),
        (["keys", "create", "--help"], 0),
        (["walk"], 2),
        (["serve", "--port", "many"], 2),
        (["keys", "create"], 2),
        (["solve"], 2),
        (["solve", "problem.json", "--csv", "-"], 0),
        (["sweep", "sweep.json"], 0),
        (["compile"], 0),
    ],
    ids=str,
)
def test_help_usage_and_what_a_worker_does_load_nothing(arguments, code, tmp_path):
    assert_free(loaded_by("service.cli.main", *arguments, folder=tmp_path), code, EVERYTHING)


@pytest.mark.parametrize(
    ("arguments", "code"), [(["worker"], 0), (["doctor"], 0), (["serve", "--workers", "-1"], 2)], ids=str
)
def test_commands_that_need_the_settings_load_only_these(arguments, code, tmp_path):
    loaded = loaded_by("service.cli.main", *arguments, folder=tmp_path)
    assert_free(loaded, code, EVERYTHING)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    "arguments", [["migrate"], ["keys", "list"], ["prune", "--samples-older-than", "1d"]], ids=str
)
def test_commands_that_use_the_database_load_no_solver_and_no_web_framework(arguments, tmp_path):
    assert_free(loaded_by("service.cli.main", *arguments, folder=tmp_path), 0, SOLVERS | WEB)


@pytest.mark.parametrize(("arguments", "code"), [([], 2), (["walk"], 2)], ids=str)
def test_the_usage_of_a_worker_loads_no_solver_and_no_database(arguments, code, tmp_path):
    assert_free(
        loaded_by("workers.__main__", *arguments, folder=tmp_path), code, SOLVERS | ARRAYS | STORE | WEB
    )


def test_the_parent_of_a_child_that_solves_loads_no_solver(tmp_path):
    loaded = modules_of("import workers.cli.documents, workers.process.tasks", tmp_path)
    assert loaded & (SOLVERS | WEB | STORE) == set()


def test_a_worker_loads_of_its_database_what_it_uses(tmp_path):
    """It starts beside the children and the service, and each takes processor time from the others."""
    loaded = modules_of(
        "import workers.cli.main, workers.process.start\nfrom workers.process import tasks, worker",
        tmp_path,
    )
    assert loaded & (SOLVERS | WEB | ARRAYS | (STORE - {"sqlalchemy"})) == set()


def test_the_children_of_a_worker_load_no_database(tmp_path):
    loaded = modules_of(
        "from workers.process import tasks\nfor name in tasks.PRELOAD: __import__(name)", tmp_path
    )
    assert loaded & (STORE | WEB | {"matplotlib", "rich", "pyarrow"}) == set()


SERVING = """
import asyncio, sys
import service.cli.server, service.cli.http_server
imported = set(sys.modules)  # what follows is of the test: httpx loads rich
from httpx import ASGITransport, AsyncClient
from service.app import create_app
from service.settings import Settings

PROBLEM = {
    "body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": -1},
    "motion": {"type": "planar", "lambda": 1}, "time": {"stop": 1, "samples": 3},
}

async def main():
    app = create_app(Settings())
    async with app.router.lifespan_context(app):
        transport = ASGITransport(app)
        async with AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            assert (await client.get("/livez")).status_code == 200
            assert (await client.get("/readyz")).status_code == 200
            before = set(sys.modules)
            answers = [
                await client.post("/v1/validations", json={k: PROBLEM[k] for k in ("body", "potential")}),
                await client.post("/v1/jobs", json=PROBLEM),
                await client.post("/v1/jobs", json=[PROBLEM]),
                await client.get("/v1/jobs"),
                await client.get("/v1/accuracy"),
                await client.get("/metrics"),
            ]
            assert [answer.is_success for answer in answers] == [True] * len(answers)
    return {name for name in set(sys.modules) - before if not name.startswith("encodings.")}

print(*imported)
print(*asyncio.run(main()))
"""


def test_the_service_loads_no_solver_and_nothing_for_its_first_requests(tmp_path, sqlite_template):
    imported, later = run(SERVING, tmp_path, POLHODE_DATABASE_URL=copy_of(sqlite_template, tmp_path))
    packages = {name.partition(".")[0] for name in imported}
    later_or_never = {"alembic", "matplotlib", "rich", "workers", "pyarrow", "jinja2"}
    assert packages & (SOLVERS | later_or_never) == set()
    assert later == []


def assert_free(loaded, code, forbidden):
    assert (loaded[0], loaded[1] & forbidden) == (code, set())


def modules_of(statement, folder):
    code = f"import sys\n{statement}\nprint(*sys.modules)"
    return {name.partition(".")[0] for name in run(code, folder)[0]}


def run(code, folder, **environment):
    """Return the words of each line that the code writes."""
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={**os.environ, **environment, "PYTHONPATH": str(ROOT)},
    )
    assert result.returncode == 0, result.stderr
    return [line.split() for line in result.stdout.splitlines()]
