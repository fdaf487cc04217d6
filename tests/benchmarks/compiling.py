"""What compiling the kernels costs, function by function, so that the next growth is seen.

All groups are compiled into an empty folder, in the order in which the compiling task goes through them, by a
process that has loaded nothing yet. Seconds are those of the processor. Those of a function are its own: what
is translated for it on the way counts for itself. Machine code is made for what Python calls.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict

from numba.core import event
from numba.core.event import Event, Listener

from service.local.workers import FOLDER_VARIABLE
from service.startup import collect_seldom
from tests.benchmarks.measuring import Effort, Table, in_words
from workers.computation.compiled_code import (
    GROUPS,
    allow_compiling,
)
from workers.sweeping.warming import compile_group

LISTED = 40
Row = tuple[str, str, float]
"""A group, a function, its processor seconds; machine code has the name of what Python calls."""


class Watch(Listener):
    """Listens to the compiler: which function, and how long, without what is compiled on the way."""

    def __init__(self) -> None:
        self.done: list[tuple[str, float]] = []
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
        name = f"{function.__module__}.{function.__qualname__}".removeprefix("workers.solvers.compiled.")
        # numba's own functions have no kind.
        is_entry = event.data.get("kind") == "entry"
        self.done.append((name + " (machine code)" * is_entry, whole - inner))


def main() -> None:
    """Compile everything in this process, and print what each function took."""
    collect_seldom()
    allow_compiling()
    rows = list[Row]()
    for group in GROUPS:
        watch = Watch()
        event.register("numba:compile", watch)
        began = time.process_time()
        compile_group(group)
        # Loading, solving, writing.
        rest = time.process_time() - began - sum(seconds for _, seconds in watch.done)
        event.unregister("numba:compile", watch)
        rows += [(group, *each) for each in (*watch.done, ("all else", rest))]
    sys.stdout.write(json.dumps(rows))


def compiling(_: Effort) -> Table:
    """Compile everything; the dearest functions, the groups, and the sums."""
    with tempfile.TemporaryDirectory() as folder:
        child = subprocess.run(
            [sys.executable, "-m", "tests.benchmarks.compiling"],
            env={**os.environ, FOLDER_VARIABLE: folder},
            stdout=subprocess.PIPE,
            check=True,
        )
    rows: list[Row] = json.loads(child.stdout)
    times, seconds, groups = Counter[str](), defaultdict[str, float](float), defaultdict[str, float](float)
    for group, name, own in rows:
        times[name] += 1
        seconds[name] += own
        groups[group] += own
    machine = sum(own for _, name, own in rows if name.endswith(" (machine code)"))
    shown = [
        (f"group {group}", str(sum(row[0] == group for row in rows) - 1), groups[group]) for group in groups
    ]
    shown += [("all", str(len(rows) - len(groups)), sum(groups.values()))]
    shown += [("machine code", str(sum(row[1].endswith(" (machine code)") for row in rows)), machine)]
    dearest = sorted(seconds, key=seconds.__getitem__, reverse=True)[:LISTED]
    shown += [(name, str(times[name]), seconds[name]) for name in dearest]
    remark = (
        "Into an empty folder, by one process. What a function calls counts for itself, and so does the "
        "machine code of what Python calls, with all that it reaches."
    )
    return Table(
        "Compiling the kernels",
        remark,
        ("function", "types of arguments", "processor"),
        tuple((name, count, in_words(took)) for name, count, took in shown),
    )


if __name__ == "__main__":
    main()
