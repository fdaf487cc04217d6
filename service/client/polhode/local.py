"""A service of one's own on this machine, which ends with the program that started it."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TypeVar

from polhode.clients import Client
from polhode.connecting import terms_of
from polhode.errors import PolhodeError, WrongArgumentError
from polhode.motions import Motion
from polhode.transport.carriers import ThreadCarrier
from polhode.transport.exchange import ask_json
from polhode.transport.steps import Operation

T = TypeVar("T")

_ADDRESS = re.compile(r"serving (http://\S+?),")
_START_SECONDS = 120.0
_END_SECONDS = 30.0


class ServiceDiedError(PolhodeError):
    """The service did not start; the message has what it said last."""


class TellingCarrier(ThreadCarrier):
    """Says once on stderr that solvers are still being compiled, where a motion was solved without them."""

    _has_told = False

    def run(self, steps: Operation[T]) -> T:
        """Return the operation's result; what it raises passes through."""
        result = super().run(steps)
        if isinstance(result, Motion) and result.way == "plain" and not self._has_told:
            self._has_told = True
            ready = super().run(ask_json(self.terms, "GET", "/readyz"))
            match ready.get("compiling"):
                case {"done": done, "of": of, "seconds": seconds}:
                    left = "" if seconds is None else f", about {seconds:.0f} s"
                    how_far = f", which are compiled in the background ({done} of {of}{left})"
                case _:
                    how_far = ""
            print(f"polhode: solved without the fast solvers{how_far}", file=sys.stderr)  # noqa: T201
        return result


class LocalClient(Client):
    """A client with a service of its own; :meth:`close` ends both."""

    def __init__(self, carrier: ThreadCarrier, keeper: "subprocess.Popen[bytes]") -> None:
        super().__init__(carrier)
        self._keeper = keeper

    def close(self) -> None:
        """End the service, and delete its database if it was a temporary one."""
        super().close()
        _end(self._keeper)


def local(
    database: str | os.PathLike[str] | None = None, *, workers: int | None = None, cache: bool = True
) -> LocalClient:
    """Start a service and return a client of it; the service ends with this program, or by ``close()``.

    It takes about five seconds. On a new machine solvers are compiled in the background, which is told on
    stderr with the first motion that is solved without them.

    Parameters
    ----------
    database
        A SQLite file, or a URL as for POLHODE_DATABASE_URL; a temporary one if left out.
    workers
        Jobs that are computed at the same time; one for each processor but one if left out.

    Raises
    ------
    WrongArgumentError
        There is no program ``polhode`` on this machine.
    ServiceDiedError
        It did not start.
    """
    folder = Path(tempfile.mkdtemp(prefix="polhode-"))
    count = max(1, (os.cpu_count() or 2) - 1) if workers is None else workers
    command = [_program(), "serve", "--host", "127.0.0.1", "--port", "0", "--workers", str(count)]
    environment = {**os.environ, "POLHODE_DATABASE_URL": _url(database, folder), "POLHODE_LOG_FORMAT": "text"}
    keeper = subprocess.Popen(
        [sys.executable, "-P", "-m", "polhode.keeper", str(folder), *command],
        stdin=subprocess.PIPE,
        env=environment,
        # Ctrl-C in a notebook interrupts its cell, not the service.
        start_new_session=True,
    )
    try:
        terms = terms_of(_address(keeper, folder / "log"), cache=cache)
        return LocalClient(TellingCarrier(terms), keeper)
    except BaseException:
        _end(keeper)
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _program() -> str:
    beside = Path(sys.executable).with_name("polhode")
    found = str(beside) if beside.exists() else shutil.which("polhode")
    if found is None:
        raise WrongArgumentError(
            "the program polhode is not installed here; connect(url) asks a service on another machine"
        )
    return found


def _url(database: str | os.PathLike[str] | None, folder: Path) -> str:
    if database is None:
        return f"sqlite:///{folder / 'polhode.db'}"
    text = os.fspath(database)
    return text if "://" in text else f"sqlite:///{Path(text).absolute()}"


def _address(keeper: "subprocess.Popen[bytes]", log: Path) -> str:
    deadline = time.monotonic() + _START_SECONDS
    while time.monotonic() < deadline:
        is_over = keeper.poll() is not None
        said = log.read_text(encoding="utf-8", errors="replace") if log.exists() else ""
        if found := _ADDRESS.search(said):
            return found[1]
        if is_over:
            break
        time.sleep(0.02)
    said = log.read_text(encoding="utf-8", errors="replace") if log.exists() else ""
    raise ServiceDiedError(f"the service did not start: {said[-1000:].strip() or 'it said nothing'}")


def _end(keeper: "subprocess.Popen[bytes]") -> None:
    assert keeper.stdin is not None
    keeper.stdin.close()
    try:
        keeper.wait(_END_SECONDS)
    except subprocess.TimeoutExpired:
        keeper.kill()
        keeper.wait()
