"""Submitted problems: to wait for them, or to cancel them."""

from collections.abc import Mapping, Sequence
from typing import Generic

from polhode.documents.problems import Document
from polhode.errors import FailedError, PolhodeError, RefusedError, WrongArgumentError
from polhode.listings import IDS, by_id
from polhode.motions import Motion
from polhode.transport.carriers import CarrierT
from polhode.transport.exchange import FINAL, ask_json, follow
from polhode.transport.steps import Operation, Pause, operation
from polhode.transport.terms import Progress, Terms

WAIT_SECONDS = 20
"""Seconds for which the service holds a request whose job is being solved; proxies may end longer ones."""
_LIST = 1000
"""Problems in one request, as many as the service takes."""
_FIRST_PAUSE, _LONGEST_PAUSE = 0.05, 1.0


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


class SomeFailedError(PolhodeError):
    """Some problems of a list were refused or failed.

    Parameters
    ----------
    errors
        Why, by the index in the list.
    motions
        Those of the others, by the index in the list.
    """

    def __init__(self, errors: Mapping[int, PolhodeError], motions: Mapping[int, object]) -> None:
        self.errors, self.motions = errors, motions
        first = min(errors)
        super().__init__(
            f"{len(errors)} of {len(errors) + len(motions)} problems; number {first}: {errors[first]}"
        )


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


def solve_list(carrier: CarrierT, problems: Sequence[Document]) -> Operation[list[Motion[CarrierT]]]:
    """Return the motions of many problems, in their order.

    Raises
    ------
    SomeFailedError
        Not all of them have one.
    """
    errors: dict[int, PolhodeError] = {}
    waiting: dict[int, str] = {}
    for first in range(0, len(problems), _LIST):
        part = list(problems[first : first + _LIST])
        for index, item in enumerate((yield from _submitted(carrier.terms, part)), first):
            if isinstance(job := item.get("job"), Mapping):
                waiting[index] = str(job["id"])
            else:
                problem = item.get("problem")
                refusal = problem if isinstance(problem, Mapping) else {}
                errors[index] = RefusedError(int(str(item.get("status"))), refusal)
    jobs = yield from _ended(carrier.terms, list(dict.fromkeys(waiting.values())))
    solutions: dict[str, str] = {}
    for index, job_id in waiting.items():
        if jobs[job_id].get("state") == "succeeded":
            solutions[job_id] = str(jobs[job_id]["solution"])
        else:
            errors[index] = FailedError(jobs[job_id])
    found = yield from by_id(carrier.terms, "/v1/solutions", list(dict.fromkeys(solutions.values())))
    motions = {
        index: Motion(carrier, found[solutions[job_id]])
        for index, job_id in waiting.items()
        if job_id in solutions
    }
    if errors:
        raise SomeFailedError(errors, motions)
    return [motions[index] for index in range(len(problems))]


def _submitted(terms: Terms, problems: Sequence[Document]) -> Operation[list[Document]]:
    try:
        answer = yield from ask_json(terms, "POST", "/v1/jobs", list(problems))
    except RefusedError as fault:
        # A list of which nothing was accepted is refused as a whole, with the same items.
        items = fault.document.get("items")
        if not isinstance(items, list):
            raise
        return items
    items = answer["items"]
    if not isinstance(items, list):
        raise WrongArgumentError("the answer to a list of problems is no list: is there another service?")
    return items


def _ended(terms: Terms, ids: Sequence[str]) -> Operation[dict[str, Document]]:
    """Return the jobs once all have ended."""
    done: dict[str, Document] = {}
    pause = _FIRST_PAUSE
    while True:
        open_ids = [each for each in ids if each not in done][:IDS]
        jobs = yield from by_id(terms, "/v1/jobs", open_ids)
        ended = {each: job for each, job in jobs.items() if job.get("state") in FINAL}
        done |= ended
        if terms.progress is not None and ids:
            terms.progress(Progress("jobs", len(done), len(ids), None, len(done) == len(ids)))
        if len(done) == len(ids):
            return done
        if len(ended) == len(open_ids):
            pause = _FIRST_PAUSE  # the next of them may have ended meanwhile
            continue
        yield Pause(pause)
        pause = min(1.3 * pause, _LONGEST_PAUSE)
