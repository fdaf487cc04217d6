"""The service that a client speaks to, how long it is waited for, and what is kept on disk."""

import contextlib
import hashlib
import ipaddress
import json
import os
import tempfile
import urllib.request
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit, urlunsplit

from polhode.errors import WrongArgumentError
from polhode.transport.steps import Reply

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
