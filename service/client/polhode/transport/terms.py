"""The service that a client speaks to, and the patience with it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from polhode.transport.cache import Cache

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
    """Told how far a sweep or a list of jobs is."""
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
