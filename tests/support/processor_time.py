"""``--durations=N`` also lists the files and the folders whose tests took the most processor time.

How long a test takes says as much of what else the machine does; what it
costs a processor says more of the test. Time of child processes counts once
they have ended, to the test in which they did; what the last test of a process
takes down is of the whole session: services, browsers and servers.
"""

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import PurePosixPath

import pytest

_SPENT = "processor_seconds"
_IS_SHARED = "is_of_the_session"
_elsewhere = [0.0]


def add(seconds: float) -> None:
    """Count what a process took that has ended and was nobody's child here."""
    _elsewhere[0] += seconds


def _now() -> float:
    """Return the seconds of processor time of this process and of its children that have ended."""
    return sum(os.times()[:4]) + _elsewhere[0]


class ProcessorTime:
    """A plugin of pytest; with ``pytest-xdist`` every process measures and one sums."""

    def __init__(self, listed: int) -> None:
        self._listed = listed
        self._mark = _now()
        self._is_last = False
        self._files: Counter[str] = Counter()

    def pytest_collection_finish(self) -> None:
        self._mark = _now()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, nextitem: pytest.Item | None) -> None:
        self._is_last = nextitem is None

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Iterator[None]:
        """Note at the report of a phase (set up, call, tear down) what it cost; xdist sends it along."""
        report = yield
        now = _now()
        setattr(report, _SPENT, now - self._mark)
        setattr(report, _IS_SHARED, self._is_last and report.when == "teardown")
        self._mark = now
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        is_shared = getattr(report, _IS_SHARED, False)
        file = "what a session shares" if is_shared else report.nodeid.partition("::")[0]
        self._files[file] += getattr(report, _SPENT, 0.0)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        folders: Counter[str] = Counter()
        for file, seconds in self._files.items():
            folders[str(PurePosixPath(file).parent)] += seconds
        for what, spent in (("files", self._files), ("folders", folders)):
            terminalreporter.write_sep("=", f"processor time of {what}, {spent.total():.0f} s in all")
            for name, seconds in spent.most_common(self._listed or None):
                terminalreporter.write_line(f"{seconds:8.2f}s {name}")
