"""What compiling the kernels costs, function by function, so that the next growth is seen.

All groups are compiled in this process, into a folder that is empty, in the order in which the compiling task
goes through them. Seconds are those of the processor, and of a function alone: what is compiled for it on the
way counts for itself.
"""

import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

from numba.core import event
from numba.core.event import Event, Listener

from tests.benchmarks.measuring import Effort, Table, in_words
from workers.computation.compiled_code import FOLDER_VARIABLE, GROUPS, allow_compiling
from workers.sweeping.warming import compile_group

LISTED = 40


class Watch(Listener):
    """Listens to the compiler: which function, for how many types of arguments, and how long."""

    def __init__(self) -> None:
        self.seconds, self.times = defaultdict[str, float](float), defaultdict[str, int](int)
        self._begun: list[list[float]] = []

    def on_start(self, event: Event) -> None:
        """Remember when it was."""
        self._begun.append([time.thread_time(), 0.0])

    def on_end(self, event: Event) -> None:
        """Take the seconds of a function, less those of the ones that were compiled on the way."""
        began, inner = self._begun.pop()
        whole = time.thread_time() - began
        if self._begun:
            self._begun[-1][1] += whole
        function = event.data["dispatcher"].py_func
        name = f"{function.__module__.removeprefix('workers.solvers.compiled.')}.{function.__name__}"
        self.seconds[name] += whole - inner
        self.times[name] += 1


@contextmanager
def listening(watch: Watch) -> Iterator[None]:
    """Have the compiler tell ``watch``."""
    event.register("numba:compile", watch)
    try:
        yield
    finally:
        event.unregister("numba:compile", watch)


def compiling(_: Effort) -> Table:
    """Compile everything; the dearest functions, the groups, and the sums."""
    watch, rows, before = Watch(), list[tuple[str, ...]](), os.environ.get(FOLDER_VARIABLE)
    with tempfile.TemporaryDirectory() as folder, listening(watch):
        os.environ[FOLDER_VARIABLE] = folder
        try:
            allow_compiling()
            for group in GROUPS:
                known, made = sum(watch.seconds.values()), sum(watch.times.values())
                compile_group(group)
                seconds, count = sum(watch.seconds.values()) - known, sum(watch.times.values()) - made
                rows.append((f"group {group}", str(count), in_words(seconds)))
        finally:
            if before is None:
                del os.environ[FOLDER_VARIABLE]
            else:
                os.environ[FOLDER_VARIABLE] = before
    rows.append(("all", str(sum(watch.times.values())), in_words(sum(watch.seconds.values()))))
    dearest = sorted(watch.seconds, key=watch.seconds.__getitem__, reverse=True)[:LISTED]
    rows += [(name, str(watch.times[name]), in_words(watch.seconds[name])) for name in dearest]
    remark = "Into an empty folder, by one process; what a function calls counts for itself."
    return Table(
        "Compiling the kernels", remark, ("function", "types of arguments", "processor"), tuple(rows)
    )
