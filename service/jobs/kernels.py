"""The equipment that workers report: kernels, with their consequences for jobs and sweeps, and a cluster."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal  # Any: a summary, which may be damaged

from service.schemas.reading.documents import Document, Part

KERNELS = 315
"""How many functions are translated or made machine code of, each for the types of its arguments, as counted:
what is reported as to be done."""
PLAIN_POINT_SECONDS = 0.1
"""Seconds that a point takes without kernels: 0.01 to 0.2."""
LARGEST_STATES = 1e-10
"""Tolerance below which motions from a state are integrated by kernels only."""
_UNKNOWN_SECONDS = 90.0
"""Seconds that compiling is assumed to take, as long as nobody knows better."""

WAITS = "waits for kernels, which are being compiled"
"""Why a job is queued again that has no plain way."""
NEVER = "kernels, which might do it, cannot be compiled here"
"""Why a job has ended that has no plain way."""
FASTER = "polhode compile, once on a machine, makes what follows faster"
"""Said by commands that start nothing which outlives them."""

Way = Literal["compiled", "plain"]
Outlook = Literal["there", "coming", "never"]
"""Whether a worker has all kernels, it or another one that shares its queue will, or nobody."""


class NeedsKernelsError(Exception):
    """The plain way does not lead to a final answer: the job waits for its kernels.

    Attributes
    ----------
    refusal
        Code, detail and pointer of what the plain way says, which is final where nobody will have kernels;
        None where it was not gone.
    """

    def __init__(self, refusal: Mapping[str, object] | None = None) -> None:
        super().__init__(refusal)
        self.refusal = refusal

    def __str__(self) -> str:
        return WAITS


@dataclass(frozen=True, slots=True)
class Kernels:
    """The progress of compiling kernels, where they are not all there."""

    done: int
    of: int
    seconds: float | None
    """About how many are left until all are there; None as long as nobody knows."""
    fault: str | None = None
    """Why they never will be."""
    waits: str | None = None
    """Why compiling does not begin yet."""

    @staticmethod
    def read(document: Mapping[str, object]) -> "Kernels":
        """Return what :meth:`document` has written; raises TypeError, ValueError for anything else."""
        names = ("done", "of", "seconds", "fault", "waits")
        done, of, seconds, fault, waits = (document.get(name) for name in names)
        if not isinstance(done, int) or not isinstance(of, int):
            raise TypeError("a number of kernels is missing")
        left = float(seconds) if isinstance(seconds, int | float) else None
        why = (None if each is None else str(each) for each in (fault, waits))
        return Kernels(done, of, left, *why)

    def document(self) -> dict[str, object]:
        """Return it for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        if self.fault is not None:
            return f"not compiled: {self.fault}"
        if self.waits is not None:
            return f"not compiled yet: {self.waits}"
        left = "" if self.seconds is None else f", about {self.seconds:.0f} s"
        return f"compiling: {self.done} of {self.of}{left}"


def most_missing(kernels: Iterable[Kernels]) -> Kernels | None:
    """Return the ones that will never be there, else those with the most left to do; None without any."""
    return min(kernels, key=lambda each: (each.fault is None, each.done - each.of), default=None)


def way_of_solution(summary: Mapping[str, Any]) -> Way:
    """Return the way that a solution was computed on; before it was recorded, there was one."""
    return "plain" if (summary.get("provenance") or {}).get("way") == "plain" else "compiled"


def way_of_sweep(document: Mapping[str, object], points: int, kernels: Kernels | None) -> Way:
    """Return the way on which a sweep is done sooner, where its first worker has so many ``kernels``.

    None: it has all.
    """
    if kernels is None:
        return "compiled"
    if kernels.fault is not None:
        return "plain"
    seconds = _UNKNOWN_SECONDS if kernels.seconds is None else kernels.seconds
    is_sooner = points * PLAIN_POINT_SECONDS <= seconds
    return "plain" if is_sooner and not _has_no_plain_way(document) else "compiled"


def _has_no_plain_way(document: Mapping[str, object]) -> bool:
    """Tell whether points are motions from states that only kernels know so well."""
    base = document.get("base")
    if not isinstance(base, Mapping):
        return False
    motion, accuracy = base.get("motion"), base.get("accuracy")
    if not isinstance(motion, Mapping) or motion.get("type") != "state" or not isinstance(accuracy, Mapping):
        return False
    tolerance = accuracy.get("tolerance")
    is_small = isinstance(tolerance, int | float | str) and float(tolerance) < LARGEST_STATES
    return is_small or accuracy.get("tier") in ("high", "certified")


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A worker of the cluster that computes nothing, and why."""

    worker: str
    why: str


@dataclass(frozen=True, slots=True)
class ClusterState:
    """A cluster's workers."""

    scheduler: str
    is_connected: bool
    workers: int
    """Number of workers that are ready."""
    threads: int
    """Batches that they compute at the same time."""
    left_out: tuple[LeftOut, ...]
    dashboard: str | None
    """Address of Dask's own page, if it has one."""

    def document(self) -> Document:
        """Return it as it is stored."""
        return asdict(self)

    @classmethod
    def read(cls, document: Part) -> "ClusterState":
        """Return what :meth:`document` was made of."""
        dashboard = document["dashboard"]
        return cls(
            scheduler=str(document["scheduler"]),
            is_connected=bool(document["is_connected"]),
            workers=int(str(document["workers"])),
            threads=int(str(document["threads"])),
            left_out=tuple(LeftOut(str(each["worker"]), str(each["why"])) for each in document["left_out"]),
            dashboard=None if dashboard is None else str(dashboard),
        )
