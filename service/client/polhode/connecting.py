"""Makes clients of a service that runs somewhere, or of one that is started here."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from polhode.clients import AsyncClient, Client
from polhode.drawing import Bar, is_watched
from polhode.errors import PolhodeError, WrongArgumentError
from polhode.motions import Motion
from polhode.transport.carriers import LoopCarrier, ThreadCarrier, leave_at_forks
from polhode.transport.exchange import ask_json
from polhode.transport.terms import DEFAULT_URL, Cache, Operation, Progress, Terms, default_folder


def connect(
    url: str | None = None,
    key: str | None = None,
    *,
    patience: float = 120.0,
    cache: bool | str | os.PathLike[str] = True,
    progress: bool | Callable[[Progress], None] | None = None,
) -> Client:
    """Return a client of the service at ``url``; nothing is sent before something is asked.

    Parameters
    ----------
    url
        POLHODE_URL if left out, else http://127.0.0.1:8000.
    key
        The API key; POLHODE_KEY if left out, else none.
    patience
        Seconds for which requests without an answer are sent again; what makes something is made once.
    cache
        Keep on disk what never changes: in POLHODE_CACHE or a folder of this user, or in the folder given.
    progress
        Draw a bar, or what to tell the progress; None: a bar on terminals and in notebooks.
    """
    return Client(ThreadCarrier(terms_of(url, key, patience, cache=cache, progress=progress)))


def connect_async(
    url: str | None = None,
    key: str | None = None,
    *,
    patience: float = 120.0,
    cache: bool | str | os.PathLike[str] = True,
    progress: bool | Callable[[Progress], None] | None = None,
) -> AsyncClient:
    """Return a client whose operations are awaited; the arguments are those of :func:`connect`."""
    return AsyncClient(LoopCarrier(terms_of(url, key, patience, cache=cache, progress=progress)))


def terms_of(
    url: str | None,
    key: str | None = None,
    patience: float = 120.0,
    *,
    cache: bool | str | os.PathLike[str] = True,
    progress: bool | Callable[[Progress], None] | None = None,
) -> Terms:
    """Return on which terms a client asks; the arguments are those of :func:`connect`."""
    address = (url or os.environ.get("POLHODE_URL") or DEFAULT_URL).rstrip("/")
    if not address.startswith(("http://", "https://")):
        raise WrongArgumentError(f"{address!r} is no address; such as {DEFAULT_URL} is accepted")
    folder = default_folder() if isinstance(cache, bool) else Path(cache)
    if progress is None:
        progress = is_watched()
    report = Bar() if progress is True else progress or None
    answers = None if cache is False else Cache(folder)
    return Terms(address, key or os.environ.get("POLHODE_KEY"), patience, answers, report)


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
        self._keeper, self._process = keeper, os.getpid()
        leave_at_forks(self)

    def close(self) -> None:
        """End the service, and delete its database if it was a temporary one; a forked process does not."""
        super().close()
        if self._process == os.getpid():
            _end(self._keeper)

    def leave(self) -> None:
        """Let the service end with the program that started it, however long a forked process lives."""
        if self._keeper.stdin is not None:
            self._keeper.stdin.close()

    def __reduce__(self) -> tuple[type[Client], tuple[ThreadCarrier]]:
        return Client, (self.carrier,)


def local(
    database: str | os.PathLike[str] | None = None, *, workers: int | None = None, cache: bool = True
) -> LocalClient:
    """Start a service and return a client of it; the service ends with this program, or by ``close()``.

    It takes about five seconds. On a new machine solvers are compiled in the background, which is reported on
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
            "the program polhode is not installed here: local() needs the service beside the client, which"
            " pip install . in a checkout of polhode installs; connect(url) asks one that runs elsewhere"
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
