"""The service that a client speaks to, how long it is waited for, what is kept; operations as generators.

Operations yield what they need from outside, and never wait or send themselves. The same operation is carried
out by a thread or by an event loop; ``operation`` makes it a method that returns its result in the one case,
and something to await in the other.
"""

import contextlib
import hashlib
import ipaddress
import json
import os
import re
import tempfile
import urllib.request
from collections.abc import Callable, Coroutine, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import update_wrapper
from inspect import Signature, formatannotation, signature
from pathlib import Path
from types import MethodType
from typing import Concatenate, Generic, ParamSpec, Protocol, TypeVar, get_args, overload
from urllib.parse import urlsplit, urlunsplit

from polhode.errors import WrongArgumentError

P = ParamSpec("P")
T = TypeVar("T")
Owner = TypeVar("Owner")


@dataclass(frozen=True, slots=True)
class Send:
    """Send a request, and receive the whole answer."""

    method: str
    path: str
    """Below the address of the service, with the query."""
    headers: Mapping[str, str] = field(default_factory=dict)
    content: bytes | None = None
    is_stream: bool = False
    """Receive the head only; the lines follow one by one by :class:`NextLine`."""


@dataclass(frozen=True, slots=True)
class NextLine:
    """Receive the next line of the stream that was opened last."""


@dataclass(frozen=True, slots=True)
class Pause:
    """Wait."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Together:
    """Carry out operations at the same time, all to their ends; the first of what they raise is thrown in."""

    operations: "Sequence[Operation[None]]"


@dataclass(frozen=True, slots=True)
class Reply:
    """The result of a step; names of headers are in lower case."""

    status: int = 0
    headers: Mapping[str, str] = field(default_factory=dict)
    content: bytes = b""
    line: str | None = None
    """The line that :class:`NextLine` asked for; None at the end of the stream."""


class LostConnectionError(Exception):
    """No answer, or not all of it, has arrived; thrown into the operation that asked."""


Step = Send | NextLine | Pause | Together
Operation = Generator[Step, Reply, T]


class Thread(Protocol):
    """Carries out operations in the thread that calls."""

    def run(self, steps: Operation[T]) -> T:
        """Return the operation's result."""


class Loop(Protocol):
    """Carries out operations in an event loop."""

    async def run_soon(self, steps: Operation[T]) -> T:
        """Return the operation's result."""


class Synchronous(Protocol):
    """Whose operations return their results."""

    @property
    def carrier(self) -> Thread:
        """The carrier that carries the operations out."""


class Asynchronous(Protocol):
    """Whose operations are awaited."""

    @property
    def carrier(self) -> Loop:
        """The carrier that carries the operations out."""


class operation(Generic[Owner, P, T]):  # noqa: N801 - used as a decorator
    """A method written once, as a generator, for both kinds of owner."""

    def __init__(self, function: Callable[Concatenate[Owner, P], Operation[T]]) -> None:
        def call(owner: Owner, /, *given: P.args, **named: P.kwargs) -> object:
            steps = function(owner, *given, **named)
            carrier: object = owner.carrier  # type: ignore[attr-defined]  # both kinds of owner have one
            return carrier.run_soon(steps) if hasattr(carrier, "run_soon") else carrier.run(steps)  # type: ignore[attr-defined]

        self.call = update_wrapper(call, function)
        self.call.__signature__ = as_called(signature(function))  # type: ignore[attr-defined]  # they take any

    @overload
    def __get__(self, instance: None, owner: type) -> Callable[Concatenate[Owner, P], object]: ...
    @overload
    def __get__(self, instance: Synchronous, owner: type) -> Callable[P, T]: ...
    @overload
    def __get__(self, instance: Asynchronous, owner: type) -> Callable[P, Coroutine[object, object, T]]: ...
    def __get__(self, instance: object, owner: type) -> object:
        """Return the method bound to ``instance``: a method as any other, which pickles by its name."""
        return self.call if instance is None else MethodType(self.call, instance)


def as_called(own: Signature) -> Signature:
    """Return the signature of an operation as a person calls it: with the result, without the steps."""
    result = (get_args(own.return_annotation) or (own.return_annotation,))[-1]
    parameters = [
        each if each.annotation is each.empty else each.replace(annotation=_words(each.annotation))
        for each in own.parameters.values()
    ]
    return own.replace(parameters=parameters, return_annotation=_words(result))


_NUMBER = "int | float | str | fractions.Fraction | decimal.Decimal"
_PATHS = re.compile(r"(polhode|collections|numpy|os)(\.\w+)*\.|\[~CarrierT\]|~")


def _words(annotation: object) -> "_Words":
    text = re.sub(r"ForwardRef\('(.*?)'\)", r"\1", formatannotation(annotation))
    return _Words(_PATHS.sub("", text.replace(_NUMBER, "Exact")))


class _Words(str):
    """An annotation that is shown as it is."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


_CACHED_HEADERS = ("content-type", "etag", "polhode-error", "polhode-samples")
_DEFAULT_MEGABYTES = 500


class Cache:
    """A folder with an answer a file, readable by its owner only.

    Parameters
    ----------
    folder
        Made when the first answer is cached.
    megabytes
        The size above which the answers that were used least recently are deleted.
    """

    def __init__(self, folder: Path, megabytes: float = _DEFAULT_MEGABYTES) -> None:
        self.folder, self._limit = folder, int(megabytes * 1e6)
        self._written = 0

    def find(self, url: str, accept: str) -> Reply | None:
        """Return the cached answer, or None; a damaged file is none."""
        path = self._path(url, accept)
        try:
            head, _, content = path.read_bytes().partition(b"\n")
            known = json.loads(head)
            if known.pop("length") != len(content):
                return None
            os.utime(path)
        except (OSError, ValueError, KeyError, AttributeError):
            return None
        return Reply(200, known, content)

    def keep(self, url: str, accept: str, reply: Reply) -> None:
        """Keep an answer if it says that it never changes; a full disk is no fault."""
        if reply.status != 200 or "immutable" not in reply.headers.get("cache-control", ""):
            return
        known = {name: reply.headers[name] for name in _CACHED_HEADERS if name in reply.headers}
        head = json.dumps({**known, "length": len(reply.content)}).encode()
        with contextlib.suppress(OSError):
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            # Written beside and renamed: other processes see all of a file or nothing.
            handle, name = tempfile.mkstemp(dir=self.folder)
            with os.fdopen(handle, "wb") as file:
                file.write(head + b"\n" + reply.content)
            Path(name).replace(self._path(url, accept))
            self._written += len(reply.content)
            if self._written > self._limit // 10:
                self._written = 0
                self._trim()

    def _path(self, url: str, accept: str) -> Path:
        return self.folder / hashlib.sha256(f"{accept} {url}".encode()).hexdigest()

    def _trim(self) -> None:
        files = [(path, path.stat()) for path in self.folder.iterdir()]
        excess = sum(state.st_size for _, state in files) - self._limit
        for path, state in sorted(files, key=lambda pair: pair[1].st_mtime):
            if excess <= 0:
                return
            path.unlink(missing_ok=True)
            excess -= state.st_size


def default_folder() -> Path:
    """Return POLHODE_CACHE, or the folder for caches of this user."""
    if own := os.environ.get("POLHODE_CACHE"):
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "polhode"


DEFAULT_URL = "http://127.0.0.1:8000"


def is_loopback(url: str) -> bool:
    """Tell whether an address is one of this machine."""
    host = urlsplit(url).hostname or ""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost" or host.endswith(".localhost")


@dataclass(frozen=True, slots=True)
class Proxy:
    """A proxy by which requests go, and where it is named."""

    address: str
    variable: str

    def __str__(self) -> str:
        # A password is nobody's to read in a message.
        parts = urlsplit(self.address)
        shown = urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))
        return f"the proxy {shown} of {self.variable}"


def proxy_of(url: str) -> Proxy | None:
    """Return the proxy that the environment names for an address; loopback never has one.

    NO_PROXY takes names with all below them, addresses, and networks such as 10.0.0.0/8 and ::1/128.
    """
    parts = urlsplit(url)
    host = parts.hostname or ""
    named = urllib.request.getproxies()
    kind = next((kind for kind in (parts.scheme, "all") if named.get(kind)), None)
    if kind is None or is_loopback(url) or _is_excepted(host, parts.netloc, named.get("no", "")):
        return None
    names = (f"{kind}_proxy", f"{kind}_proxy".upper())
    variable = next((name for name in names if os.environ.get(name)), "the system's settings")
    address = named[kind]
    return Proxy(address if "://" in address else f"http://{address}", variable)


def _is_excepted(host: str, with_port: str, listed: str) -> bool:
    if urllib.request.proxy_bypass(with_port) or urllib.request.proxy_bypass(host):
        return True
    for each in listed.split(","):
        with contextlib.suppress(ValueError):
            if ipaddress.ip_address(host) in ipaddress.ip_network(each.strip().strip("[]"), strict=False):
                return True
    return False


@dataclass(slots=True)
class Terms:
    """The settings and the state that all operations of one client share."""

    url: str
    key: str | None = None
    patience: float = 120.0
    """Seconds for which a request without an answer is sent again."""
    cache: Cache | None = None
    progress: Callable[["Progress"], None] | None = None
    """Called with how far a sweep or a list of jobs is."""
    has_answered: bool = field(default=False, init=False)
    """Whether the service has ever answered; if not, its address may be wrong, and patience is short."""
    has_events: bool = field(default=True, init=False)
    """Whether the service, and all proxies before it, pass on events; if not, clients poll."""
    proxy: Proxy | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self.proxy = proxy_of(self.url)

    def __reduce__(self) -> tuple[Callable[..., "Terms"], tuple[object, ...]]:
        """Return how another process makes them: with the key of its own environment.

        Raises
        ------
        WrongArgumentError
            The key is not that of POLHODE_KEY, and no pickle ever has a key.
        """
        if self.key is not None and self.key != os.environ.get(KEY_VARIABLE):
            raise WrongArgumentError(
                "a client whose key was given as an argument cannot be sent to another process: pickles never"
                f" have keys; a key in {KEY_VARIABLE} is accepted, which each process reads itself"
            )
        return _in_another_process, (self.url, self.patience, self.cache)

    @property
    def headers(self) -> Mapping[str, str]:
        """The headers of every request."""
        own = {"Authorization": f"Bearer {self.key}"} if self.key else {}
        # On one machine packing and unpacking take longer than copying.
        return {**own, **({"Accept-Encoding": "identity"} if is_loopback(self.url) else {})}


KEY_VARIABLE = "POLHODE_KEY"


def _in_another_process(url: str, patience: float, cache: Cache | None) -> Terms:
    return Terms(url, os.environ.get(KEY_VARIABLE), patience, cache)


@dataclass(frozen=True, slots=True)
class Progress:
    """The progress of a sweep, a list of jobs, or a study."""

    what: str
    done: int
    total: int
    remaining_seconds: float | None
    """Estimated by the service; None if it does not know."""
    is_over: bool
