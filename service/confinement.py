"""Limits of processes: whether the system leaves room to start, and those of a new child, which dies with us.

A child never outlives the process that asked for it, even if that process is killed:
the kernel sends it SIGKILL when the pipe to it closes. PR_SET_PDEATHSIG alone is not
enough, since it follows the fork server, which lives as long as any child. It is set
too: children that have lost their fork server cannot be monitored, and would go on
taking calls from the pipe of their successors.
"""

import ctypes
import fcntl
import multiprocessing
import os
import resource
import signal
import sys
import threading
from multiprocessing.process import BaseProcess
from pathlib import Path

from service.collector import keep_what_is_loaded
from service.logs import Logging, start_logging

_MB, _MIB = 10**6, 1024 * 1024
_PR_SET_PDEATHSIG = 1


def lack_of_room(*, tasks: int, megabytes: int) -> str | None:
    """Return which limit of the system is too low for so many processes and threads, or so many megabytes.

    Without this a start would fail anywhere, and say so in a dozen ways. None if there is room.
    """
    most, _ = resource.getrlimit(resource.RLIMIT_NPROC)
    # The kernel does not count those of root.
    if os.geteuid() != 0 and most != resource.RLIM_INFINITY and most < tasks:
        return f"the limit of {most} processes and threads (ulimit -u) is too low: {tasks} are needed"
    room, _ = resource.getrlimit(resource.RLIMIT_AS)
    if room != resource.RLIM_INFINITY and room < megabytes * _MB:
        found = f"the limit of {room // _MB} MB of address space (ulimit -v)"
        return f"{found} is too low: {megabytes} MB are needed"
    return None


def confine_child(memory_mb: int | None, logging: Logging | None) -> None:
    """Prepare a new child."""
    keep_what_is_loaded()
    if logging is not None:
        start_logging(logging.format, logging.level)
    # Die at once on SIGTERM: a Python handler would wait for compiled code to return.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    # Ctrl-C in a terminal reaches every process; the parent decides when its children stop.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        _die_with(parent)
    if memory_mb is not None and sys.platform == "linux":
        _limit_memory(memory_mb * _MIB)


def _die_with(parent: BaseProcess) -> None:
    pipe = parent.sentinel
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))  # with the fork server, too
        fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    # Elsewhere a thread watches the pipe; it has to wait for compiled code that holds the interpreter.
    # Here it covers a parent that died before the signal was set up.
    threading.Thread(target=_kill_self_after, args=(parent,), daemon=True).start()


def _kill_self_after(parent: BaseProcess) -> None:
    parent.join()
    os.kill(os.getpid(), signal.SIGKILL)


def _limit_memory(extra: int) -> None:
    """Limit the private writable memory: threads and compilers reserve address space freely."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmData:"))
    limit = int(line.split()[1]) * 1024 + extra
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
