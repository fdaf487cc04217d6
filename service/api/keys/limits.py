"""Limits requests, jobs and storage per API key, or for all clients together if there are no keys."""

import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus

from service.api.replies import ApiError
from service.dynamics.problem import Problem, TimeList
from service.jobs.keys import ApiKey
from service.jobs.records import POINTS_PER_JOB, queued_as
from service.schemas.reading.documents import Fault, InvalidProblemError
from service.settings import Settings
from service.storage.keys import KeyStore

QUEUE_RETRY_SECONDS = 10
STORAGE_RETRY_SECONDS = 3600
"""Retry-After where the waiting time is not known."""
COUNT_SECONDS = 1.0
"""How long a count of live jobs is reused; jobs submitted since are added to it."""
MEGABYTE = 10**6


class TokenBucket:
    """A token bucket: fills at ``rate`` tokens a second, holds one second's worth and at least one."""

    def __init__(self, rate: float, now: float) -> None:
        self.rate = rate
        self._size = max(1.0, rate)
        self._tokens, self._filled_at = self._size, now

    def headers(self) -> dict[str, str]:
        """Return the state of the bucket as headers, by the draft of the RateLimit headers.

        ``q`` requests are accepted in ``w`` seconds; ``r`` are left, all of them again after ``t`` seconds.
        """
        window, missing = math.ceil(self._size / self.rate), self._size - self._tokens
        return {
            "RateLimit-Policy": f'"requests";q={int(self._size)};w={window}',
            "RateLimit": f'"requests";r={int(self._tokens)};t={math.ceil(missing / self.rate)}',
        }

    def take(self, now: float) -> float:
        """Take a token and return 0, or return the seconds until there is one."""
        self._tokens = min(self._size, self._tokens + (now - self._filled_at) * self.rate)
        self._filled_at = now
        if self._tokens >= 1.0:
            self._tokens -= 1.0
            return 0.0
        return (1.0 - self._tokens) / self.rate


@dataclass(slots=True)
class _Count:
    """Live jobs of a key, sweeps included: as counted, and those admitted since."""

    jobs: int
    counted_at: float


class LimitGuard:
    """Refuses requests beyond the limits of a key. Thread-safe.

    Requests are counted in this process alone. Jobs are counted in the
    database, once a second and whenever the limit seems reached; in between,
    admitted jobs are added. Several processes, and simultaneous requests, may
    exceed a limit by as much as they admit in that time.
    """

    def __init__(
        self, settings: Settings, store: KeyStore, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._settings, self._store, self._clock = settings, store, clock
        self._taking = threading.Lock()
        self._buckets: dict[str | None, TokenBucket] = {}
        self._counting = threading.Lock()
        """Held while the database counts; :meth:`admit`, which every request calls, must not wait for it."""
        self._counts: dict[str | None, _Count] = {}

    def admit(self, key: ApiKey | None) -> dict[str, str]:
        """Admit one request, and return the headers that tell how many more would be.

        Raises
        ------
        ApiError
            429: too many requests per second.
        """
        own = None if key is None else key.requests_per_second
        rate = self._settings.requests_per_second if own is None else own
        with self._taking:
            now = self._clock()
            bucket = self._buckets.get(_id(key))
            if bucket is None or bucket.rate != rate:
                bucket = self._buckets[_id(key)] = TokenBucket(rate, now)
            wait, headers = bucket.take(now), bucket.headers()
        if wait > 0:
            refusal = f"at most {rate:g} requests per second are accepted"
            raise _too_many("too_many_requests", refusal, wait, headers)
        return headers

    def reserve_jobs(self, key: ApiKey | None, count: int = 1, *, is_estimate: bool = False) -> None:
        """Admit ``count`` jobs to the queue; an estimate is admitted likewise, and takes no place.

        Raises
        ------
        ApiError
            429: too many jobs are queued or running, or too much is stored.
        """
        self._reserve(
            key,
            count,
            lambda known, _: f"{known} jobs are queued or running, and {count} more were sent",
            is_estimate=is_estimate,
        )

    def reserve_points(self, key: ApiKey | None, points: int, *, is_estimate: bool = False) -> None:
        """Admit a sweep, or an estimate of it, which takes no place.

        :data:`~service.jobs.records.POINTS_PER_JOB` points count as a job.

        Raises
        ------
        ApiError
            429: too many jobs are queued or running, or too much is stored.
        """
        count = queued_as(points)

        def why(known: int, limit: int) -> str:
            room = max(limit - known, 0) * POINTS_PER_JOB
            return (
                f"{known} jobs are queued or running, and the {points} points of the sweep count as {count} "
                f"more ({POINTS_PER_JOB} points as one job); a sweep of {room} points would be accepted now"
            )

        self._reserve(key, count, why, is_estimate=is_estimate)

    def _reserve(
        self, key: ApiKey | None, count: int, why: Callable[[int, int], str], *, is_estimate: bool
    ) -> None:
        self._check_storage(key)
        own = None if key is None else key.max_queued_jobs
        limit = self._settings.max_queued_jobs if own is None else own
        with self._counting:
            now = self._clock()
            known = self._counts.get(_id(key))
            if known is None or now - known.counted_at > COUNT_SECONDS or known.jobs + count > limit:
                jobs = self._store.live_jobs(_id(key), at_most=limit)
                known = self._counts[_id(key)] = _Count(jobs, now)
            if known.jobs + count > limit:
                detail = f"{why(known.jobs, limit)}; at most {limit} are accepted"
                # What an empty queue would refuse has to be asked for in parts.
                extras = {"exceeds_limit": True} if count > limit else {}
                raise _too_many("too_many_queued_jobs", detail, QUEUE_RETRY_SECONDS, extras=extras)
            known.jobs += 0 if is_estimate else count

    def _check_storage(self, key: ApiKey | None) -> None:
        if key is None:
            return  # without a key nothing is charged
        own = key.max_stored_bytes
        limit = self._settings.max_stored_mb * MEGABYTE if own is None else own
        if key.stored_bytes >= limit:
            detail = (
                f"{key.stored_bytes / MEGABYTE:.1f} MB are stored for key {key.prefix}; "
                f"at most {limit / MEGABYTE:g} are accepted"
            )
            raise _too_many("storage_limit", detail, STORAGE_RETRY_SECONDS)


def check_problem_samples(problem: Problem, settings: Settings) -> None:
    """Make sure that a problem asks for no more samples than the installation allows.

    Raises
    ------
    InvalidProblemError
        It asks for more.
    """
    listed = isinstance(problem.time, TimeList)
    samples = problem.time.samples
    if samples > settings.max_samples:
        pointer = "/time/times" if listed else "/time/samples"
        raise InvalidProblemError([_too_many_samples(pointer, samples, settings)])


def query_samples_faults(samples: int, settings: Settings) -> list[Fault]:
    """Return the fault of the number of samples in a query, if it exceeds the limit."""
    return [_too_many_samples("?samples", samples, settings)] if samples > settings.max_samples else []


def _too_many_samples(pointer: str, samples: int, settings: Settings) -> Fault:
    return Fault(pointer, "out_of_range", f"{samples} samples; 1 to {settings.max_samples} are accepted here")


def _too_many(
    code: str,
    detail: str,
    seconds: float,
    headers: Mapping[str, str] = {},
    extras: Mapping[str, object] = {},
) -> ApiError:
    headers = {"Retry-After": str(math.ceil(seconds)), **headers}
    return ApiError(HTTPStatus.TOO_MANY_REQUESTS, code, detail, headers=headers, extras=extras)


def _id(key: ApiKey | None) -> str | None:
    return None if key is None else key.id
