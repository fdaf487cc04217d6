"""Makes workers by forking: what a worker needs is loaded once, not in each of some hundred."""

import contextlib
import ctypes
import json
import os
import selectors
import socket
import sys
import traceback
from collections.abc import Callable, Sequence

from sqlalchemy.orm import configure_mappers

import workers.process.start as needed_by_every_worker

assert needed_by_every_worker
MESSAGE_BYTES = 2**16
CLONE_NEWNET = 0x40000000
"""A flag of Linux's clone: the caller leaves the network of its parent."""


def fork_whenever_asked(line: int, work: Callable[[Sequence[str]], None]) -> None:
    """Fork for each request that comes by the ``line``, a socket, until nobody holds its other end.

    A request is a JSON document of the folder, the environment and the
    arguments; with it come a socket and perhaps a wake-up socket. The socket is told the
    fork's id, and at its end its exit code and the seconds of processor time.
    """
    configure_mappers()
    control, selector = socket.socket(fileno=line), selectors.DefaultSelector()
    selector.register(control, selectors.EVENT_READ)
    while True:
        for key, _ in selector.select():
            if key.fileobj is not control:
                selector.unregister(key.fileobj)
                os.close(key.fd)
                _tell_end(*key.data)
                continue
            content, descriptors, _, _ = socket.recv_fds(control, MESSAGE_BYTES, 2)
            if not content:
                return
            told, wake_up = socket.socket(fileno=descriptors[0]), descriptors[1:]
            pid = os.fork()
            if pid == 0:
                selector.close()
                control.close()
                _run(json.loads(content), told, wake_up, work)
            for descriptor in wake_up:
                os.close(descriptor)
            selector.register(os.pidfd_open(pid), selectors.EVENT_READ, (pid, told))


def _tell_end(pid: int, told: socket.socket) -> None:
    _, status, usage = os.wait4(pid, 0)
    # Whoever asked may not want to know any more.
    with told, contextlib.suppress(OSError):
        told.send(f"{os.waitstatus_to_exitcode(status)} {usage.ru_utime + usage.ru_stime}\n".encode())


def _run(
    request: dict, told: socket.socket, wake_up: Sequence[int], work: Callable[[Sequence[str]], None]
) -> None:
    """Be a worker; never return."""
    code = 1
    try:
        os.setsid()
        # Not earlier: who has the id looks for the processes of its session.
        with told:
            told.send(f"{os.getpid()}\n".encode())
        if request["has_own_network"] and ctypes.CDLL(None).unshare(CLONE_NEWNET) != 0:
            raise PermissionError("no network of its own is allowed")
        os.chdir(request["folder"])
        os.environ.clear()
        os.environ.update(request["environment"])
        work([*request["arguments"], *map(str, wake_up)])
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)
