"""Submitted problems: to wait for them, or to cancel them."""

from typing import Generic

from polhode.documents.problems import Document
from polhode.errors import FailedError
from polhode.motions import Motion
from polhode.transport.carriers import CarrierT
from polhode.transport.exchange import FINAL, ask_json, follow
from polhode.transport.terms import Operation, Terms, operation

WAIT_SECONDS = 20
"""Seconds for which the service holds a request whose job is being solved; proxies may end longer ones."""


class Job(Generic[CarrierT]):
    """A problem that was submitted.

    Attributes
    ----------
    document
        The job as the service described it last.
    """

    def __init__(self, carrier: CarrierT, document: Document) -> None:
        self.carrier, self.document = carrier, document

    @property
    def id(self) -> str:
        """Id of the job."""
        return str(self.document["id"])

    @property
    def state(self) -> str:
        """``queued``, ``running``, ``succeeded``, ``failed`` or ``cancelled``, when last asked."""
        return str(self.document["state"])

    @property
    def progress(self) -> float:
        """Finished share of the job when last asked, 0 to 1."""
        return float(str(self.document["progress"]))

    @operation
    def wait(self, *, seconds: float | None = None) -> Operation[Motion[CarrierT]]:
        """Return the motion once the job has ended.

        Raises
        ------
        FailedError
            The job failed or was cancelled.
        UnfinishedError
            It took longer than ``seconds``; it goes on.
        """
        terms = self.carrier.terms
        known = self.document if self.state in FINAL else None
        self.document = yield from follow(terms, f"/v1/jobs/{self.id}", known, seconds=seconds)
        return (yield from motion_of(self.carrier, self.document))

    @operation
    def refresh(self) -> Operation[str]:
        """Ask for the job again, and return its state."""
        self.document = yield from ask_json(self.carrier.terms, "GET", f"/v1/jobs/{self.id}")
        return self.state

    @operation
    def cancel(self) -> Operation[None]:
        """Cancel the job.

        Raises
        ------
        RefusedError
            It has succeeded or failed already.
        """
        self.document = yield from ask_json(self.carrier.terms, "POST", f"/v1/jobs/{self.id}/cancel")

    def __repr__(self) -> str:
        return f"<job {self.id}: {self.state}>"


def submit(terms: Terms, document: Document, *, seconds: int) -> Operation[Document]:
    """Submit a problem and return its job; the service waits for up to ``seconds`` until it is done."""
    headers = {"Prefer": f"wait={seconds}"} if seconds else {}
    return (yield from ask_json(terms, "POST", "/v1/jobs", document, headers=headers))


def motion_of(carrier: CarrierT, job: Document) -> Operation[Motion[CarrierT]]:
    """Return the motion of a job that has ended.

    Raises
    ------
    FailedError
        The job failed or was cancelled.
    """
    if job.get("state") != "succeeded":
        raise FailedError(job)
    path = f"/v1/solutions/{job['solution']}"
    return Motion(carrier, (yield from ask_json(carrier.terms, "GET", path)))
