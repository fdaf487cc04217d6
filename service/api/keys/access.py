"""The API keys, cached in the serving process, and the table of the role each endpoint needs.

Keys are read anew every two seconds, so that requests need no query. An endpoint that is not in the
table is not served. Endpoints are found by the shape of their path: the number of its parts and the first
two of them. /v1/jobs/ID has the shape of /v1/jobs/{job_id}, so a request is compared with the few
paths that look alike. No template has a parameter in those two parts.
"""

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime, timedelta
from http import HTTPStatus
from typing import Generic, TypeVar

from anyio import CapacityLimiter, to_thread
from fastapi import APIRouter
from fastapi.routing import APIRoute
from sqlalchemy.exc import SQLAlchemyError
from starlette.exceptions import HTTPException
from starlette.routing import compile_path

from service.jobs.keys import ApiKey, Role
from service.logs import Complaints
from service.storage.keys import USED_SECONDS, KeyStore

_log = logging.getLogger(__name__)

FRESH_SECONDS = 2.0
"""Largest age of the cache: a created or revoked key is noticed after at most this time."""
SECOND_LOOK_SECONDS = 0.2
"""An unknown key makes the keys be read again if they are older than this."""


@dataclass(frozen=True, slots=True)
class Known:
    """All keys by their prefixes, as read at one instant."""

    keys: Mapping[str, ApiKey]
    now: datetime
    """The instant by the database's clock."""
    read_at: float
    """The same instant by the process's own clock."""


class KeyRing:
    """Looks keys up, and records their use. Thread-safe."""

    def __init__(self, store: KeyStore, clock: Callable[[], float] = time.monotonic) -> None:
        self._store, self._clock = store, clock
        self._lock = threading.Lock()
        self._complaints = Complaints(_log)
        self._known: Known | None = None
        self._noted: dict[str, float] = {}
        self._looking = CapacityLimiter(1)
        """A thread of its own, so that requests are authenticated although all other threads are busy."""
        self._notes = ThreadPoolExecutor(max_workers=1, thread_name_prefix="keys")

    async def known(self, max_age: float = FRESH_SECONDS) -> Known:
        """Return the keys as they were at most ``max_age`` seconds ago."""
        known = self._fresh(max_age)
        if known is not None:
            return known
        return await to_thread.run_sync(self._look, max_age, limiter=self._looking)

    def now(self, known: Known) -> datetime:
        """Estimate the database's clock from the last read, without a query."""
        return known.now + timedelta(seconds=self._clock() - known.read_at)

    def note_use(self, key: ApiKey) -> None:
        """Record the use of a key, once a minute, in a background thread."""
        now = self._clock()
        if now - self._noted.get(key.id, -USED_SECONDS) >= USED_SECONDS:
            self._noted[key.id] = now
            self._notes.submit(self._touch, key)

    def close(self) -> None:
        """Finish the writes in progress, and accept no more."""
        self._notes.shutdown(wait=True, cancel_futures=True)

    def _fresh(self, max_age: float) -> Known | None:
        known = self._known
        return known if known is not None and self._clock() - known.read_at <= max_age else None

    def _look(self, max_age: float) -> Known:
        with self._lock:
            known = self._fresh(max_age)
            if known is None:
                began = self._clock()
                found = self._store.all()
                known = Known({key.prefix: key for key in found.keys}, found.now, began)
                self._known = known
            return known

    def _touch(self, key: ApiKey) -> None:
        try:
            self._store.touch(key.id)
        except SQLAlchemyError:
            self._complaints.tell(f"the last use of key {key.prefix} could not be recorded", kind="use")


T = TypeVar("T")
_NAMED = 3
"""Parts that the shape spells out; the first is empty, in front of the slash that begins a path."""


class ByShape(Generic[T]):
    """A mapping from templates of paths to values.

    Parameters
    ----------
    rows
        Template and value; the order is kept among values of one shape.
    """

    def __init__(self, rows: Iterable[tuple[str, T]]) -> None:
        self._values: dict[tuple[int, str], list[T]] = {}
        for template, value in rows:
            self._values.setdefault(_shape(template), []).append(value)

    def of(self, path: str) -> Sequence[T]:
        """Return the values of the templates that look like ``path``; others cannot match it."""
        return self._values.get(_shape(path), ())


def _shape(path: str) -> tuple[int, str]:
    parts = path.split("/")
    return len(parts), "/".join(parts[:_NAMED])


OPEN = None
"""Open to everybody, even if keys are required: shows no stored data."""
OPTIONS = "OPTIONS"
"""The method that asks which methods a path has; every path has it."""

ACCESS: Mapping[str, Mapping[str, Role | None]] = {
    "/livez": {"GET": OPEN},
    "/readyz": {"GET": OPEN},
    "/metrics": {"GET": Role.METRICS},
    # The page and its files hold no data: it asks for them with the key typed into it.
    "/": {"GET": OPEN},
    "/workbench": {"GET": OPEN},
    "/solutions": {"GET": OPEN},
    "/jobs": {"GET": OPEN},
    "/studies": {"GET": OPEN},
    "/sweeps": {"GET": OPEN},
    "/families": {"GET": OPEN},
    "/accuracy": {"GET": OPEN},
    "/solution": {"GET": OPEN},
    "/study": {"GET": OPEN},
    "/sweep": {"GET": OPEN},
    "/static/page/{version}/{name}": {"GET": OPEN},
    # The documentation page, into which a key can be typed: it is the same for every installation.
    "/docs": {"GET": OPEN, "HEAD": OPEN},
    "/docs/favicon-32x32.png": {"GET": OPEN, "HEAD": OPEN},
    "/docs/start.js": {"GET": OPEN, "HEAD": OPEN},
    "/docs/swagger-ui-bundle.js": {"GET": OPEN, "HEAD": OPEN},
    "/docs/swagger-ui.css": {"GET": OPEN, "HEAD": OPEN},
    "/openapi.json": {"GET": OPEN, "HEAD": OPEN},
    "/v1/accuracy": {"GET": Role.READ},
    "/v1/events": {"GET": Role.READ},
    "/v1/families": {"GET": Role.READ},
    # Stores nothing; keys take turns with the children, and one may wait with half of the places.
    "/v1/validations": {"POST": Role.READ},
    "/v1/atlases": {"GET": Role.READ, "POST": Role.SUBMIT},
    "/v1/atlases/{atlas_id}": {"GET": Role.READ},
    "/v1/jobs": {"GET": Role.READ, "POST": Role.SUBMIT},
    "/v1/jobs/facets": {"GET": Role.READ},
    "/v1/jobs/statistics": {"GET": Role.READ},
    # Changes of what the same key submitted; those of others' need OPERATE, which the endpoints check.
    "/v1/jobs/{job_id}": {"GET": Role.READ, "PATCH": Role.SUBMIT, "DELETE": Role.SUBMIT},
    "/v1/jobs/{job_id}/attempts": {"GET": Role.READ},
    "/v1/jobs/{job_id}/cancel": {"POST": Role.SUBMIT},
    "/v1/jobs/{job_id}/events": {"GET": Role.READ},
    "/v1/jobs/{job_id}/result": {"GET": Role.READ},
    "/v1/integrals": {"POST": Role.SUBMIT},
    "/v1/integrals/searches": {"POST": Role.SUBMIT},
    "/v1/potentials/searches": {"POST": Role.SUBMIT},
    "/v1/searches": {"POST": Role.SUBMIT},
    "/v1/solutions": {"GET": Role.READ},
    "/v1/solutions/facets": {"GET": Role.READ},
    "/v1/solutions/statistics": {"GET": Role.READ},
    "/v1/solutions/{solution_id}": {"GET": Role.READ, "PATCH": Role.SUBMIT, "DELETE": Role.SUBMIT},
    "/v1/solutions/{solution_id}/audits": {"GET": Role.READ, "POST": Role.SUBMIT},
    "/v1/solutions/{solution_id}/audits/{audit_id}": {"GET": Role.READ},
    "/v1/solutions/{solution_id}/citation": {"GET": Role.READ},
    "/v1/solutions/{solution_id}/enclosures": {"GET": Role.READ},
    "/v1/solutions/{solution_id}/provenance": {"GET": Role.READ},
    "/v1/solutions/{solution_id}/function": {"GET": Role.READ},
    "/v1/solutions/{solution_id}/trajectory": {"GET": Role.READ},
    "/v1/sweeps": {"GET": Role.READ, "POST": Role.SUBMIT},
    "/v1/sweeps/{sweep_id}": {"GET": Role.READ, "PATCH": Role.SUBMIT, "DELETE": Role.SUBMIT},
    "/v1/sweeps/{sweep_id}/cancel": {"POST": Role.SUBMIT},
    "/v1/sweeps/{sweep_id}/events": {"GET": Role.READ},
    "/v1/sweeps/{sweep_id}/jobs": {"GET": Role.READ},
    "/v1/sweeps/{sweep_id}/provenance": {"GET": Role.READ},
    "/v1/status": {"GET": Role.READ},
    "/v1/problems/{digest}/solutions": {"GET": Role.READ},
    "/v1/sweeps/{sweep_id}/package": {"GET": Role.READ},
    "/v1/sweeps/{sweep_id}/grid": {"GET": Role.READ},
    "/v1/sweeps/{sweep_id}/points": {"GET": Role.READ},
    "/v1/sweeps/{sweep_id}/points/facets": {"GET": Role.READ},
    "/v1/sweeps/{sweep_id}/points/statistics": {"GET": Role.READ},
}


class MissingRoleError(LookupError):
    """An endpoint has no row in the table of roles."""

    def __init__(self, endpoint: str) -> None:
        super().__init__(f"{endpoint} needs a row in service/api/keys/access.py with its role")


class Access:
    """Finds the role that a request needs."""

    def __init__(self) -> None:
        self._places = ByShape((path, (compile_path(path)[0], roles)) for path, roles in ACCESS.items())

    def needed(self, method: str, path: str) -> Role | None:
        """Return the role, or OPEN; where several rows match, the highest of theirs.

        OPTIONS needs the least of a path's roles: whoever may do anything there may ask what there is.

        Raises
        ------
        HTTPException
            404 if there is no such path, 405 if it does not have that method.
        """
        found = self._roles(path)
        if method == OPTIONS:
            return min((role for roles in found for role in roles.values()), key=_rank)
        wanted = [roles[method] for roles in found if method in roles]
        if not wanted:
            raise HTTPException(HTTPStatus.METHOD_NOT_ALLOWED, headers={"Allow": self.allowed(path)})
        return max(wanted, key=_rank)

    def allowed(self, path: str) -> str:
        """Return the value of the Allow header of a path; HEAD is wherever GET is."""
        methods = {OPTIONS, *(method for roles in self._roles(path) for method in roles)}
        return ", ".join(sorted(methods | ({"HEAD"} if "GET" in methods else set())))

    def _roles(self, path: str) -> list[Mapping[str, Role | None]]:
        if path in ACCESS:
            # Such as /v1/jobs/facets, which looks like the path of a job.
            return [ACCESS[path]]
        found = [roles for pattern, roles in self._places.of(path) if pattern.match(path)]
        if not found:
            raise HTTPException(HTTPStatus.NOT_FOUND)
        return found


def _rank(role: Role | None) -> int:
    return -1 if role is OPEN else list(Role).index(role)


def check_roles(routers: Iterable[APIRouter]) -> None:
    """Make sure that the table has all endpoints.

    Raises
    ------
    MissingRoleError
        An endpoint is missing.
    """
    for method, path in endpoints(routers):
        if method not in ACCESS.get(path, {}):
            raise MissingRoleError(f"{method} {path}")


def endpoints(routers: Iterable[APIRouter]) -> Iterator[tuple[str, str]]:
    """Return method and path of every endpoint."""
    for router in routers:
        for route in router.routes:
            if isinstance(route, APIRoute):
                yield from ((method, route.path) for method in sorted(route.methods or ()))
