"""Exports the metrics of the service in the Prometheus text format.

Requests are counted by this process. Metrics of jobs are read from the
database, since workers are other processes and other hosts: every process of
the service reports the same numbers about them.
"""

import logging
from collections.abc import Callable, Iterator

from prometheus_client import CollectorRegistry, Histogram, ProcessCollector, generate_latest
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4
from prometheus_client.registry import Collector
from sqlalchemy.exc import SQLAlchemyError

from service.api.verdicts.examiner import CachedExaminations
from service.jobs.kernels import ClusterState
from service.jobs.records import AttemptOutcome, JobKind
from service.local.workers import WorkerStanding
from service.logs import Complaints
from service.storage.upkeep.statistics import BOUNDS, LIVE, Durations, Figures, Statistics

logger = logging.getLogger(__name__)


TEXT_FORMAT = CONTENT_TYPE_PLAIN_0_0_4
REQUEST_BOUNDS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0, 60.0)
"""Upper bounds of the histogram of request durations, in seconds. The longest wait for a job is 60 s."""


class Metrics:
    """The metrics of one application, in a registry of its own."""

    def __init__(
        self,
        statistics: Statistics,
        *,
        version: str,
        local_worker: Callable[[], WorkerStanding] | None = None,
        kept: CachedExaminations | None = None,
    ) -> None:
        self._registry = CollectorRegistry()
        self._requests = Histogram(
            "polhode_http_request_seconds",
            "Durations of requests, by the route's template.",
            ["method", "route", "status"],
            buckets=REQUEST_BOUNDS,
            registry=self._registry,
        )
        self._database = _DatabaseCollector(statistics, version)
        self._registry.register(self._database)
        if local_worker is not None:
            self._registry.register(WorkerCollector(local_worker))
        if kept is not None:
            self._registry.register(CacheCollector(kept))
        ProcessCollector(registry=self._registry)

    def observe(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count a request that was answered."""
        self._requests.labels(method, route, str(status)).observe(seconds)

    def text(self) -> bytes:
        """Return all metrics in the Prometheus text format."""
        return generate_latest(self._registry)


class WorkerCollector(Collector):
    """Collects the status of the worker process beside this service."""

    def __init__(self, standing: Callable[[], WorkerStanding]) -> None:
        self._standing = standing

    def collect(self) -> Iterator[Metric]:
        """Yield whether it runs, how often it has died, and when it is started again."""
        now = self._standing()
        says = "The worker process of this service runs."
        yield GaugeMetricFamily("polhode_local_worker_up", says, int(now.is_running))
        yield CounterMetricFamily(
            "polhode_local_worker_deaths", "How often it has died.", now.restarts.deaths
        )
        says = "Time until it is started again after an early death; 0 while it runs."
        yield GaugeMetricFamily("polhode_local_worker_pause_seconds", says, now.seconds_to_start or 0.0)


class CacheCollector(Collector):
    """Counts how often verdicts and windows were cached already."""

    def __init__(self, kept: CachedExaminations) -> None:
        self._kept = kept

    def collect(self) -> Iterator[Metric]:
        """Yield the counter."""
        says = "Verdicts and windows that were asked for: kept already, or not."
        looked_up = CounterMetricFamily("polhode_examinations", says, labels=["outcome"])
        for outcome, count in zip(("kept", "missing"), self._kept.counts, strict=True):
            looked_up.add_metric([outcome], count)
        yield looked_up


class _DatabaseCollector(Collector):
    """Collects the metrics that are read from the database."""

    def __init__(self, statistics: Statistics, version: str) -> None:
        self._statistics = statistics
        self._version = version
        self._complaints = Complaints(logger)

    def describe(self) -> list[Metric]:
        """Return nothing, so that registering makes no query."""
        return []

    def collect(self) -> Iterator[Metric]:
        """Yield the metrics; if the database cannot be reached, only that."""
        yield InfoMetricFamily("polhode", "Version of the service.", {"version": self._version})
        try:
            figures = self._statistics.current()
        except SQLAlchemyError as fault:
            self._complaints.tell(f"no metrics of the database: {type(fault).__name__}")
            yield GaugeMetricFamily("polhode_database_up", "The database answers.", 0)
            return
        yield GaugeMetricFamily("polhode_database_up", "The database answers.", 1)
        yield from _state(figures)
        yield from _work(figures)


_OF_CLUSTERS: tuple[tuple[str, str, Callable[[ClusterState], int]], ...] = (
    ("workers", "Workers of a Dask cluster that are ready.", lambda cluster: cluster.workers),
    ("threads", "Jobs that they compute at once.", lambda cluster: cluster.threads),
    ("left_out", "Workers of it that get no jobs.", lambda cluster: len(cluster.left_out)),
)


def _state(figures: Figures) -> Iterator[Metric]:
    jobs = GaugeMetricFamily("polhode_jobs", "Jobs that are not finished.", labels=["state", "kind"])
    for state in LIVE:
        for kind in JobKind:
            jobs.add_metric([state, kind.value], figures.live.get((state, kind.value), 0))
    yield jobs
    yield GaugeMetricFamily(
        "polhode_oldest_queued_seconds",
        "Age of the job that has waited longest.",
        figures.oldest_queued_seconds,
    )
    workers = GaugeMetricFamily("polhode_workers", "Workers seen lately.", labels=["engine"])
    slots = GaugeMetricFamily("polhode_worker_slots", "Jobs they can run at once.", labels=["engine"])
    for engine, seen in figures.workers.items():
        workers.add_metric([engine], seen.count)
        slots.add_metric([engine], seen.slots)
    yield workers
    yield slots
    says = "Kernels that are still to be compiled, at the worker that has most of them."
    yield GaugeMetricFamily("polhode_kernels_missing", says, figures.kernels_missing)
    for name, says, count in _OF_CLUSTERS:
        clusters = GaugeMetricFamily(f"polhode_cluster_{name}", says, labels=["scheduler"])
        for cluster in figures.clusters:
            clusters.add_metric([cluster.scheduler], count(cluster))
        yield clusters
    sweeps = GaugeMetricFamily("polhode_sweeps", "Sweeps that are not finished.", labels=["state"])
    for state in LIVE:
        sweeps.add_metric([state], figures.sweeps.get(state, 0))
    yield sweeps
    yield GaugeMetricFamily("polhode_database_bytes", "Size of the database.", figures.database_bytes)
    says = "Size of SQLite's write-ahead log."
    yield GaugeMetricFamily("polhode_database_log_bytes", says, figures.log_bytes)
    yield GaugeMetricFamily(
        "polhode_measured_age_seconds", "Age of the numbers from the database.", figures.age()
    )
    yield GaugeMetricFamily("polhode_measuring_seconds", "Time that measuring them took.", figures.seconds)


def _work(figures: Figures) -> Iterator[Metric]:
    attempts = CounterMetricFamily("polhode_attempts", "Attempts at jobs that ended.", labels=["outcome"])
    for outcome in AttemptOutcome:
        attempts.add_metric([outcome.value], figures.ended.attempts[outcome.value])
    yield attempts
    seconds = HistogramMetricFamily(
        "polhode_job_seconds",
        "Time from claim to stored solution, of jobs that were computed.",
        labels=["method", "tier"],
    )
    for labels, durations in figures.ended.durations.items():
        seconds.add_metric(labels, _buckets(durations), durations.seconds)
    yield seconds
    done, refused = figures.points
    points = CounterMetricFamily("polhode_sweep_points", "Computed points of sweeps.", labels=["outcome"])
    points.add_metric(["solved"], done - refused)
    points.add_metric(["refused"], refused)
    yield points


def _buckets(durations: Durations) -> list[tuple[str, float]]:
    bounded = [(repr(bound), float(count)) for bound, count in zip(BOUNDS, durations.below, strict=True)]
    return [*bounded, ("+Inf", float(durations.count))]
