import os
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import is_hypothesis_test, settings

from service.startup import collect_seldom
from tests.support.api import app, client, stored, verdicts
from tests.support.databases import (
    database,
    empty_url,
    jobs,
    postgres,
    postgres_template,
    postgres_url,
    solutions,
    sqlite_template,
    sqlite_url,
    url,
)
from tests.support.effort import EFFORT, examples
from tests.support.forked_workers import IS_POSSIBLE, ForkedWorkers
from tests.support.processor_time import ProcessorTime
from tests.support.serving import running_service
from workers.computation.compiled_code import WAY_VARIABLE, allow_compiling, keep_compiled_code

# How long an example takes says something about the machine, and nothing about a law: no deadline.
# On CI the same examples are drawn each time, so that a red run is about the change and can be repeated;
# who runs the tests at home, and the honesty run, draw others every time.
SAME_EXAMPLES = os.environ.get("CI") == "true"
settings.register_profile(EFFORT, deadline=None, max_examples=examples(12, 100), derandomize=SAME_EXAMPLES)
settings.load_profile(EFFORT)

__all__ = [
    "app",
    "client",
    "database",
    "empty_url",
    "jobs",
    "postgres",
    "postgres_template",
    "postgres_url",
    "running_service",
    "solutions",
    "sqlite_template",
    "sqlite_url",
    "stored",
    "url",
    "verdicts",
]


def pytest_configure(config: pytest.Config) -> None:
    # The suites call kernels, also some that no job calls. Processes that tests start do not compile,
    # and fail where a job needs what the compiling task has not made.
    os.environ[WAY_VARIABLE] = "compiled"
    allow_compiling()
    keep_compiled_code()
    collect_seldom()
    if _may_hold_files(MEMORY):
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))
    if IS_POSSIBLE and config.getoption("tx", None):
        config.pluginmanager.register(ForkedWorkers())
    if (listed := config.option.durations) is not None:
        config.pluginmanager.register(ProcessorTime(listed))


def pytest_xdist_auto_num_workers() -> int | None:
    """Return two more than there are processors: tests also wait, for their processes or for time to pass."""
    return len(os.sched_getaffinity(0)) + 2 if sys.platform == "linux" else None


MEMORY = Path("/dev/shm")
"""Folder for what tests write: a disk takes milliseconds for each commit of SQLite, and there are many."""
_ENOUGH_BYTES = 4 * 10**9


def _may_hold_files(folder: Path) -> bool:
    """Tell whether files there are in memory, of which there is enough, and programs among them may run."""
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        return False
    about = os.statvfs(folder)
    return about.f_bavail * about.f_frsize >= _ENOUGH_BYTES and not about.f_flag & os.ST_NOEXEC


SHARED = "chromium_path", "postgres", "service"
"""Parameters and fixtures of the session that are dear to start, one for each process that runs tests."""


def _needed(item: pytest.Item) -> set[str]:
    """Return the fixtures of a test, and its parameters that are words."""
    callspec = getattr(item, "callspec", None)
    chosen = (each for each in callspec.params.values() if isinstance(each, str)) if callspec else ()
    return {*getattr(item, "fixturenames", ()), *chosen}


def _place(item: pytest.Item) -> int:
    needed = _needed(item)
    return next((place for place, name in enumerate(SHARED) if name in needed), len(SHARED))


@pytest.hookimpl(wrapper=True, tryfirst=True)  # before markers choose
def pytest_collection_modifyitems(items: list[pytest.Item]) -> Iterator[None]:
    """Leave to `make test-long` what `make test` does in part, and begin with tests that share what is dear.

    What is left are random laws with many examples, Postgres where the database does not matter, and rows of
    tables of which one in so many is enough, on each database. Tests that come first stay with one process:
    others steal the last ones.
    """
    rows: Counter[tuple[str, bool]] = Counter()
    for item in items:
        if is_hypothesis_test(getattr(item, "obj", None)):
            item.add_marker("random_law")
        if "postgres" in _needed(item) and item.get_closest_marker("any_database"):
            item.add_marker("long")
        sampled = item.get_closest_marker("one_in")
        if sampled is not None and item.get_closest_marker("long") is None:
            law = item.nodeid.partition("[")[0], "postgres" in _needed(item)
            if rows[law] % sampled.args[0]:
                item.add_marker("long")
            rows[law] += 1
    yield
    items.sort(key=_place)
