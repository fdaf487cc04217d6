"""The state of a Dask cluster, as the worker that uses it tells it to the service."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

from service.schemas.reading.documents import Document


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
    def read(cls, document: Mapping[str, object]) -> "ClusterState":
        """Return what :meth:`document` was made of."""
        left_out = document["left_out"]
        assert isinstance(left_out, list)
        dashboard = document["dashboard"]
        return cls(
            scheduler=str(document["scheduler"]),
            is_connected=bool(document["is_connected"]),
            workers=int(str(document["workers"])),
            threads=int(str(document["threads"])),
            left_out=tuple(LeftOut(str(each["worker"]), str(each["why"])) for each in left_out),
            dashboard=None if dashboard is None else str(dashboard),
        )
