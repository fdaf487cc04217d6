"""The service that a client speaks to, how long it is waited for, and what is kept on disk."""

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

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
_LOOPBACK = ("127.0.0.1", "localhost", "::1")


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

    @property
    def headers(self) -> Mapping[str, str]:
        """The headers of every request."""
        own = {"Authorization": f"Bearer {self.key}"} if self.key else {}
        # On one machine packing and unpacking take longer than copying.
        is_near = urlsplit(self.url).hostname in _LOOPBACK
        return {**own, **({"Accept-Encoding": "identity"} if is_near else {})}


@dataclass(frozen=True, slots=True)
class Progress:
    """The progress of a sweep or a list of jobs."""

    what: str
    done: int
    total: int
    remaining_seconds: float | None
    """Estimated by the service; None if it does not know."""
    is_over: bool
