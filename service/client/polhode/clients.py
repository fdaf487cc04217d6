"""The clients: everything that can be asked of a service, for threads and for event loops."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import update_wrapper
from inspect import Parameter, signature
from types import TracebackType
from typing import ParamSpec, Self, TypeVar
from urllib.parse import urlencode

from polhode.atlases import Atlas, atlas_question, draw, stored_atlas
from polhode.documents.problems import DEFAULT_KEEP, Body, Document, Given, problem, question, sweep_document
from polhode.documents.quantities import Exact, written
from polhode.errors import FailedError, MissingError
from polhode.jobs import WAIT_SECONDS, Job, motion_of, submit
from polhode.listings import Listing
from polhode.lists import JobList, motions_of, stored_list, submit_list
from polhode.motions import Motion
from polhode.studies import Judgement, Questions
from polhode.sweeps import Sweep
from polhode.transport.carriers import CarrierT, LoopCarrier, ThreadCarrier
from polhode.transport.exchange import MERGE_PATCH, ask, ask_json, follow
from polhode.transport.terms import Operation, operation

Resource = Job[CarrierT] | Motion[CarrierT] | Sweep[CarrierT]


def resource_of(carrier: CarrierT, resource_id: str) -> Operation[Resource[CarrierT]]:
    """Return what has an id.

    Raises
    ------
    MissingError
        There is no job, no solution and no sweep of this id.
    """
    for kind in (Job, Motion):
        try:
            path = f"/v1/{'jobs' if kind is Job else 'solutions'}/{resource_id}"
            return kind(carrier, (yield from ask_json(carrier.terms, "GET", path)))
        except MissingError:
            continue
    try:
        return Sweep(carrier, (yield from ask_json(carrier.terms, "GET", f"/v1/sweeps/{resource_id}")))
    except MissingError as fault:
        document = {**fault.document, "detail": f"no job, solution or sweep has the id {resource_id}"}
        raise MissingError(fault.status, document) from None


def path_of(resource: Resource[CarrierT]) -> str:
    """Return where the service has it."""
    kind = "jobs" if isinstance(resource, Job) else "sweeps" if isinstance(resource, Sweep) else "solutions"
    return f"/v1/{kind}/{resource.id}"


P = ParamSpec("P")
T = TypeVar("T")
Owner = TypeVar("Owner")

_OF_SOLUTIONS = ("id", "created_at", "family", "method", "tier", "A", "B", "C", "period", "energy", "error")
_OF_JOBS = ("id", "created_at", "state", "family", "period", "energy", "seconds", "solution")
_OF_SWEEPS = ("id", "created_at", "state", "family", "points", "done", "refused", "seconds")


def takes(
    arguments: Callable[P, Document],
) -> Callable[[Callable[[Owner, Document], Operation[T]]], operation[Owner, P, T]]:
    """Make an operation on a document one that takes the arguments which make the document."""

    def decorate(work: Callable[[Owner, Document], Operation[T]]) -> operation[Owner, P, T]:
        def whole(self: Owner, /, *given: P.args, **named: P.kwargs) -> Operation[T]:
            return (yield from work(self, arguments(*given, **named)))

        update_wrapper(whole, work)
        own, taken = signature(work), signature(arguments)
        owner = next(iter(own.parameters.values())).replace(kind=Parameter.POSITIONAL_ONLY)
        parameters = [owner, *taken.parameters.values()]
        # What notebooks and the reference show.
        whole.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]  # functions take any
        return operation(whole)

    return decorate


class Operations(Questions[CarrierT]):
    """The operations that both clients have."""

    def __init__(self, carrier: CarrierT) -> None:
        self.carrier = carrier

    @property
    def url(self) -> str:
        """Address of the service."""
        return self.carrier.terms.url

    @takes(problem)
    def solve(self, document: Document) -> Operation[Motion[CarrierT]]:
        """Solve a problem and return its motion; the arguments are those of :func:`polhode.problem`.

        Raises
        ------
        RefusedError
            The service refuses the problem; ``faults`` tell where, and what would have been accepted.
        FailedError
            It cannot be solved, for example not to the tolerance.
        """
        terms = self.carrier.terms
        job = yield from submit(terms, document, seconds=WAIT_SECONDS)
        job = yield from follow(terms, f"/v1/jobs/{job['id']}", job)
        return (yield from motion_of(self.carrier, job))

    @takes(problem)
    def submit(self, document: Document) -> Operation[Job[CarrierT]]:
        """Submit a problem and return its job at once; the arguments are those of :func:`polhode.problem`."""
        return Job(self.carrier, (yield from submit(self.carrier.terms, document, seconds=0)))

    @operation
    def submit_all(self, problems: Iterable[Given], *, again: bool = False) -> Operation[JobList[CarrierT]]:
        """Submit problems, however many, and return their jobs at once; ``errors`` has those refused.

        Parameters
        ----------
        problems
            Documents or files.
        again
            Submit all anew. If left out, a list that is submitted again within a day has the same jobs.
        """
        return (yield from submit_list(self.carrier, problems, again=again))

    @operation
    def solve_all(
        self, problems: Iterable[Given], *, again: bool = False, seconds: float | None = None
    ) -> Operation[list[Motion[CarrierT]]]:
        """Solve many problems and return their motions, in the same order.

        Parameters
        ----------
        problems, again
            As of :meth:`submit_all`.
        seconds
            How long to wait for the jobs.

        Raises
        ------
        SomeFailedError
            Not all have a motion; it has those that there are, and the errors of the others.
        UnfinishedError
            It took longer than ``seconds``; the jobs go on.
        """
        listed = yield from submit_list(self.carrier, problems, again=again)
        return (yield from motions_of(listed, seconds))

    def stored_list(self, given: Sequence[str | None] | str | os.PathLike[str]) -> JobList[CarrierT]:
        """Return a list that was submitted before, by the file that has it or by the ids of its jobs."""
        return stored_list(self.carrier, given)

    @operation
    def judge(
        self,
        /,
        potential: str | Given,
        *,
        body: Body | None = None,
        motion: Mapping[str, object] | None = None,
        lam: Exact | None = None,
        **parameters: Exact,
    ) -> Operation[Judgement[CarrierT]]:
        """Ask whether a potential admits planar motions; nothing is stored.

        Parameters
        ----------
        potential
            A formula, a section ``potential``, or without ``body`` a whole document or its file.
        body
            (A, C), (A, B, C), or the section.
        motion, lam
            The section ``motion``, or λ of a planar one, to learn its windows; or a state, to learn which
            classical cases it lies on.
        """
        document = question(potential, body=body, motion=motion, lam=lam, numbers=parameters)
        answer = yield from ask_json(self.carrier.terms, "POST", "/v1/validations", document)
        return Judgement(self.carrier, answer, document)

    @operation
    def sweep(
        self,
        /,
        base: Given,
        *,
        keep: Sequence[str] = DEFAULT_KEEP,
        combine: str = "grid",
        series: bool = False,
        wait: bool = True,
        axes: Mapping[str, object] | None = None,
        **named_axes: object,
    ) -> Operation[Sweep[CarrierT]]:
        """Solve a problem with numbers that vary along axes, and return the sweep when it has ended.

        Parameters
        ----------
        base
            A problem, a whole sweep, or a file of either.
        named_axes, axes
            Values as lists, arrays or series, or spans such as ``linspace(lo, hi, n)``, by the names of
            parameters or by JSON pointers; ``lam`` is λ. The last axis varies fastest.
        keep
            Numbers to keep of each point.
        combine
            ``grid``: every value with every other; ``zip``: the n-th values of all axes.
        series
            Keep the samples of each point, too.
        wait
            False: return at once; ``sweep.wait()`` waits later.
        """
        document = sweep_document(base, {**named_axes, **(axes or {})}, keep, combine, series=series)
        terms = self.carrier.terms
        state = yield from ask_json(terms, "POST", "/v1/sweeps", document)
        if wait:
            state |= yield from follow(terms, f"/v1/sweeps/{state['id']}", state, what="points")
        return Sweep(self.carrier, state)

    @operation
    def atlas(
        self,
        /,
        potential: str | Given,
        *,
        body: Body | None = None,
        lam: Sequence[Exact] | None = None,
        outputs: Sequence[str] | None = None,
        samples: int | None = None,
        g1_sign: int | None = None,
        g3_sign: int | None = None,
        accept: str | None = None,
        seconds: float | None = None,
        **parameters: Exact,
    ) -> Operation[Atlas[CarrierT]]:
        """Find all planar motions over a range of λ, and wait for the job if it takes long.

        Parameters
        ----------
        potential
            A formula, a section ``potential``, or without ``body`` a whole document or its file.
        body
            (A, C), (A, B, C), or the section; B is needed for stability.
        lam
            The smallest and the largest λ.
        outputs
            ``["period"]`` if left out; ``stability`` tells the multipliers, and takes long.
        samples
            About how many λ the windows are followed at.
        g1_sign, g3_sign
            Signs on the curves, 1 or -1.
        accept
            ``undecided``: also draw a potential that is neither proved admissible nor refuted.
        seconds
            How long to wait for a job.

        Raises
        ------
        RefusedError
            The potential has no atlas.
        FailedError
            The job that draws it failed or was cancelled.
        UnfinishedError
            It took longer than ``seconds``; it goes on.
        """
        document = atlas_question(
            potential,
            body=body,
            lam=lam,
            outputs=outputs,
            samples=samples,
            g1_sign=g1_sign,
            g3_sign=g3_sign,
            accept=accept,
            numbers=parameters,
        )
        return (yield from draw(self.carrier, document, seconds))

    @operation
    def stored_atlas(self, atlas_id: str) -> Operation[Atlas[CarrierT]]:
        """Return an atlas that a job has drawn."""
        return (yield from stored_atlas(self.carrier, atlas_id))

    @operation
    def solution(self, solution_id: str) -> Operation[Motion[CarrierT]]:
        """Return a stored motion.

        Raises
        ------
        MissingError
            There is none of this id; the same holds for jobs and sweeps.
        """
        return Motion(
            self.carrier, (yield from ask_json(self.carrier.terms, "GET", f"/v1/solutions/{solution_id}"))
        )

    @operation
    def job(self, job_id: str) -> Operation[Job[CarrierT]]:
        """Return a job."""
        return Job(self.carrier, (yield from ask_json(self.carrier.terms, "GET", f"/v1/jobs/{job_id}")))

    @operation
    def stored_sweep(self, sweep_id: str) -> Operation[Sweep[CarrierT]]:
        """Return a sweep that was submitted before."""
        return Sweep(self.carrier, (yield from ask_json(self.carrier.terms, "GET", f"/v1/sweeps/{sweep_id}")))

    @operation
    def find(self, thing_id: str) -> Operation[Resource[CarrierT]]:
        """Return the job, the motion or the sweep that has an id.

        Raises
        ------
        MissingError
            There is none.
        """
        return (yield from resource_of(self.carrier, thing_id))

    @operation
    def tag(
        self, thing_id: str, labels: Mapping[str, str | None], *, note: str | None = None
    ) -> Operation[Resource[CarrierT]]:
        """Change the labels of a job, a motion or a sweep, and return it; None takes a label away.

        Parameters
        ----------
        note
            Text beside the labels; unchanged if left out.
        """
        resource = yield from resource_of(self.carrier, thing_id)
        patch: Document = {"labels": written(labels)}
        if note is not None:
            patch["note"] = note
        path, headers = path_of(resource), {"Content-Type": MERGE_PATCH}
        yield from ask_json(self.carrier.terms, "PATCH", path, patch, headers=headers)
        return (yield from resource_of(self.carrier, thing_id))

    @operation
    def download(
        self, /, resource_id: str, file_format: str = "csv", **query: Exact | None
    ) -> Operation[bytes]:
        """Return the samples of a motion, or of a job's, or the points of a sweep, as a file.

        Parameters
        ----------
        file_format
            ``csv``, ``json``, ``ndjson``, ``npz``, ``arrow`` or ``parquet``.
        query
            As of the service: ``start``, ``stop``, ``samples``, ``columns``; ``where``, ``order``, ``limit``.
        """
        resource = yield from resource_of(self.carrier, resource_id)
        if isinstance(resource, Job):
            path = f"/v1/solutions/{resource.document['solution']}/trajectory"
            if resource.state != "succeeded":
                raise FailedError(resource.document)
        else:
            path = path_of(resource) + ("/points" if isinstance(resource, Sweep) else "/trajectory")
        asked = {"format": file_format, **{k: str(v) for k, v in query.items() if v is not None}}
        return (yield from ask(self.carrier.terms, "GET", f"{path}?{urlencode(asked)}", accept="*/*")).content

    def solutions(self, *where: str, order: str | None = None) -> Listing[CarrierT, Motion[CarrierT]]:
        """Return the stored motions that match conditions such as ``"period<5, family=rational"``."""
        return Listing(self.carrier, "/v1/solutions", Motion, where=where, order=order, columns=_OF_SOLUTIONS)

    def jobs(self, *where: str, order: str | None = None) -> Listing[CarrierT, Job[CarrierT]]:
        """Return the jobs that match conditions such as ``"state=failed"``."""
        return Listing(self.carrier, "/v1/jobs", Job, where=where, order=order, columns=_OF_JOBS)

    def sweeps(self, *where: str, order: str | None = None) -> Listing[CarrierT, Sweep[CarrierT]]:
        """Return the sweeps that match conditions such as ``"points>1000"``."""
        return Listing(self.carrier, "/v1/sweeps", Sweep, where=where, order=order, columns=_OF_SWEEPS)

    def __repr__(self) -> str:
        return f"<polhode at {self.url}>"


class Client(Operations[ThreadCarrier]):
    """Asks a service, and waits for what it answers."""

    def close(self) -> None:
        """Close the connections."""
        self.carrier.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class AsyncClient(Operations[LoopCarrier]):
    """Asks a service in an event loop: its operations are awaited."""

    async def close(self) -> None:
        """Close the connections."""
        await self.carrier.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()
