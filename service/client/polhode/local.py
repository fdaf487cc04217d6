"""A service of one's own on this machine, which ends with the program that started it."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from polhode.clients import Client
from polhode.connecting import connect
from polhode.errors import PolhodeError, WrongArgumentError

_ADDRESS = re.compile(r"serving (http://\S+?),")
_START_SECONDS = 120.0
_END_SECONDS = 30.0


class ServiceDiedError(PolhodeError):
    """The service did not start; the message has what it said last."""


class LocalClient(Client):
    """A client with a service of its own; :meth:`close` ends both."""

    def __init__(self, client: Client, keeper: "subprocess.Popen[bytes]") -> None:
        super().__init__(client.carrier)
        self._keeper = keeper

    def close(self) -> None:
        """End the service, and delete its database if it was a temporary one."""
        super().close()
        _end(self._keeper)


def local(
    database: str | os.PathLike[str] | None = None, *, workers: int | None = None, cache: bool = True
) -> LocalClient:
    """Start a service and return a client of it; the service ends with this program, or by ``close()``.

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
        return LocalClient(connect(_address(keeper, folder / "log"), cache=cache), keeper)
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
