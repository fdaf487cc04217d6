"""``python -m workers compile``: compiles the kernels, as the one compiling task of a machine.

It goes through the groups of kernels in the order of need; a second process compiles those for motions from
any state meanwhile. Killed and started again it goes on where it was, since each kernel is kept as soon as it
is there. Whoever comes second waits for the first, and tells how far that one is.
"""

import fcntl
import importlib
import json
import os
import pkgutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from service.jobs.kernels import KERNELS, Kernels
from service.local.workers import own_folder, why_no_folder, worker_command
from service.terminal import answer, say
from workers.computation.compiled_code import (
    GROUPS,
    Group,
    allow_compiling,
    code_in_use,
    is_ready,
    take_shipped_code,
    trim,
)
from workers.solvers import compiled
from workers.sweeping.warming import WarmingError, compile_group

ALONGSIDE: Group = "states"
"""The group that a second process compiles meanwhile: it shares little with the other groups."""
_NICENESS = 10
_ENOUGH_MB = 2000
"""Memory that must be available before a background task begins: its two processes take 0.9 GB."""
_ENOUGH_MADE = 10
"""Kernels after which it is told how long the others may take."""
_LOOK_SECONDS = 0.5


def compile_solvers(*, in_background: bool = False, is_second: bool = False) -> int:
    """Compile what is missing; return 0 if all is there.

    ``in_background`` it is at low priority, prints how far it is as lines of JSON, and ends with the process
    that started it: when its stdin is closed. One that ``is_second`` helps another task.
    """
    reason = why_no_folder()
    if reason is not None:
        say(f"compiled code cannot be kept: {reason}")
        return 1
    if in_background:
        _stay_behind()
    allow_compiling()
    began = time.monotonic()
    try:
        if is_second:
            compile_group(ALONGSIDE)
            return 0
        with _shown(in_background) as tell:
            _compile(tell, waits_for_memory=in_background)
    except WarmingError as fault:
        say(f"the solvers do not work here: {fault}")
        return 1
    except OSError as fault:
        say(f"compiled code cannot be kept: {fault}")
        return 1
    if not in_background:
        answer(f"the solvers are ready after {time.monotonic() - began:.1f} s\n")
    return 0


def _stay_behind() -> None:
    """Work at low priority, and end with the second process when stdin is closed."""
    os.nice(_NICENESS)

    def end_with_stdin() -> None:
        while os.read(0, 1):
            pass
        # Whoever starts this gives it a group of its own.
        os.killpg(os.getpgid(0), signal.SIGKILL)

    threading.Thread(target=end_with_stdin, daemon=True).start()


def _compile(tell: Callable[[Kernels], None], *, waits_for_memory: bool) -> None:
    """Compile all groups, unless another process does or has done it."""
    folder = own_folder()
    assert folder is not None
    take_shipped_code()
    if is_ready(*GROUPS):
        return
    while waits_for_memory and (available := _available_mb()) < _ENOUGH_MB:
        why = f"{available:.0f} MB of memory are available, and compiling needs {_ENOUGH_MB}"
        tell(Kernels(0, KERNELS, None, waits=why))
        time.sleep(_LOOK_SECONDS)
    notes = folder / "progress.json"
    with (folder / "lock").open("w") as lock:
        while not _is_taken(lock.fileno()):
            if is_ready(*GROUPS):
                return
            with suppress(OSError, ValueError, TypeError):
                tell(Kernels.read(json.loads(notes.read_text())))
            time.sleep(_LOOK_SECONDS)
        if is_ready(*GROUPS):
            return
        with _watched(notes, tell), _alongside() as second:
            for group in GROUPS:
                if group != ALONGSIDE or second is None or second.wait() != 0:
                    compile_group(group)
        trim(code_in_use())


def _is_taken(lock: int) -> bool:
    """Take the lock if it is free. It is one of the whole file, which network file systems have too."""
    try:
        fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


@contextmanager
def _alongside() -> Iterator["subprocess.Popen[bytes] | None"]:
    """Start the second process where there is a second processor; it ends with this one."""
    if len(os.sched_getaffinity(0)) < 2:
        yield None
        return
    second = subprocess.Popen(worker_command("compile", is_second=True), stdin=subprocess.DEVNULL)
    try:
        yield second
    finally:
        second.kill()
        second.wait()


@contextmanager
def _watched(notes: Path, tell: Callable[[Kernels], None]) -> Iterator[None]:
    """Count what is there, once a second, and tell it to others too."""
    for module in pkgutil.walk_packages(compiled.__path__, compiled.__name__ + "."):
        importlib.import_module(module.name)
    folders, is_over = code_in_use(), threading.Event()
    began, at_first = time.monotonic(), _count(folders)

    def watch() -> None:
        while not is_over.wait(1.0):
            done, elapsed = _count(folders), time.monotonic() - began
            made, left = done - at_first, max(KERNELS - done, 1)
            how_far = Kernels(
                done, done + left, round(elapsed * left / made) if made >= _ENOUGH_MADE else None
            )
            part = notes.with_suffix(f".{os.getpid()}")
            with suppress(OSError):
                part.write_text(json.dumps(how_far.document()))
                part.replace(notes)
            tell(how_far)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        is_over.set()
        watcher.join()
        notes.unlink(missing_ok=True)


def _count(folders: list[Path]) -> int:
    return sum(file.suffix == ".nbc" for each in folders if each.is_dir() for file in each.iterdir())


def _available_mb() -> float:
    """Return the memory that programs can still have, in MB; enough where the system does not tell."""
    with suppress(OSError):
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) / 1000
    return float("inf")


@contextmanager
def _shown(in_background: bool) -> Iterator[Callable[[Kernels], None]]:
    """Return what shows how far it is: lines of JSON, or a bar where stderr is a terminal."""
    if in_background:
        yield lambda how_far: answer(json.dumps(how_far.document()) + "\n")
        return
    console = Console(stderr=True)
    columns = (
        TextColumn("compiling the solvers"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.description}"),
    )
    with ExitStack() as opened:
        progress = opened.enter_context(
            Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        )
        task = progress.add_task("", total=KERNELS)

        def show(how_far: Kernels) -> None:
            left = "" if how_far.seconds is None else f"about {how_far.seconds:.0f} s"
            progress.update(task, completed=how_far.done, total=how_far.of, description=left)

        yield show
