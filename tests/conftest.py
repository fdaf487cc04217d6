import itertools
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
settings.register_profile(EFFORT, deadline=None, max_examples=examples(5, 100), derandomize=SAME_EXAMPLES)
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
    """Return three more than there are processors: tests also wait, for their processes or for time to pass.

    With two more, a machine of two processors had 1.2 of them at work. Each may have a service and a
    Chromium beside it, which take a gigabyte together.
    """
    return len(os.sched_getaffinity(0)) + 3 if sys.platform == "linux" else None


MEMORY = Path("/dev/shm")
"""Folder for what tests write: a disk takes milliseconds for each commit of SQLite, and there are many."""
_ENOUGH_BYTES = 4 * 10**9


def _may_hold_files(folder: Path) -> bool:
    """Tell whether files there are in memory, of which there is enough, and programs among them may run."""
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        return False
    about = os.statvfs(folder)
    return about.f_bavail * about.f_frsize >= _ENOUGH_BYTES and not about.f_flag & os.ST_NOEXEC


SHARED = "service", "chromium_path", "postgres"
"""Parameters and fixtures of the session that are dear to start, one for each process that runs tests."""
LONGEST = (
    "tests/conformance/http/test_schemathesis.py",
    "tests/abuse/test_readers.py",
    "tests/browser/test_keys_and_losses.py",
    "tests/browser/test_ways.py",
    "tests/container/test_commands.py",
    "tests/crash/test_processes.py",
    "tests/workers/process/engines/test_sweeps.py",
    "tests/workers/process/test_crash.py",
    # What shares nothing is dealt to the processes in turn.
    "tests/crash/test_storm.py",
    "tests/workers/sweeping/test_nothing_compiles.py",
    "tests/abuse/test_planted_modules.py",
    "tests/workers/solvers/compiled/test_linking.py",
    "tests/workers/computation/test_compiled_code.py",
    "tests/workers/process/test_clusters.py",
    "tests/workers/process/test_template.py",
    "tests/end_to_end/test_warm_start.py",
    "tests/workers/process/test_warming.py",
    "tests/test_what_is_loaded.py",
)
"""Files with tests that take longest, above all because they wait: each process begins with some of them."""


def _needed(item: pytest.Item) -> set[str]:
    """Return the fixtures of a test, and its parameters that are words."""
    callspec = getattr(item, "callspec", None)
    chosen = (each for each in callspec.params.values() if isinstance(each, str)) if callspec else ()
    return {*getattr(item, "fixturenames", ()), *chosen}


def _group(item: pytest.Item) -> int:
    """Return which of what is shared a test needs, a service last: one beside Chromium is of that page."""
    needed = _needed(item)
    return next((k for k in (1, 2, 0) if SHARED[k] in needed), len(SHARED))


def _file(item: pytest.Item) -> str:
    return item.nodeid.partition("::")[0]


def _spread(items: list[pytest.Item], processes: int) -> list[pytest.Item]:
    """Return the tests so that each process begins with those that share something dear.

    pytest-xdist gives each process an equal stretch of the list; who is done takes the last ones of others.
    So what is at the beginning of a stretch stays with one process, and ends early.
    """
    places = {name: place for place, name in enumerate(LONGEST)}
    groups: list[list[pytest.Item]] = [[] for _ in range(len(SHARED) + 1)]
    for item in sorted(items, key=lambda item: places.get(_file(item), len(LONGEST))):
        groups[_group(item)].append(item)
    *shared, others = groups
    count = sum(_file(item) in places for item in others)
    longest, others = others[:count], others[count:]
    files = [list(of) for _, of in itertools.groupby(longest, key=_file)]
    dealt: list[list[pytest.Item]] = [[] for _ in range(processes)]
    for place, file in enumerate(files):
        # The first ones to processes that share nothing.
        dealt[(len(SHARED) + place) % processes].extend(file)
    stretches: list[list[pytest.Item]] = []
    for k in range(processes):
        begun = [item for group in shared[k::processes] for item in group] + dealt[k]
        size = (len(items) - sum(map(len, stretches))) // (processes - k)
        missing = max(0, size - len(begun))
        stretches.append(begun + others[:missing])
        del others[:missing]
    return [*itertools.chain(*stretches), *others]


@pytest.hookimpl(wrapper=True, tryfirst=True)  # before markers choose
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> Iterator[None]:
    """Leave to `make test-long` what `make test` does in part, and begin with tests that share what is dear.

    What is left are random laws with many examples, Postgres where the database does not matter, and rows of
    tables of which one in so many is enough, on each database.
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
    items[:] = _spread(items, getattr(config, "workerinput", {}).get("workercount", 1))
