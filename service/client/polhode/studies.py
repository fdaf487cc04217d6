"""Studies: questions about integrals, potentials and numbers, answered at once or by a job."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic

from polhode.documents.problems import Document, Given, read
from polhode.documents.quantities import Exact, Quantity, fields, items, written
from polhode.errors import FailedError, PolhodeError, WrongArgumentError
from polhode.transport.carriers import CarrierT
from polhode.transport.exchange import ask, follow
from polhode.transport.terms import Operation, operation

WAIT_SECONDS = 20
"""Seconds for which the service holds a request that a job answers; proxies may end longer ones."""
_ACCEPTED = 202
PATHS = {
    "integral": "/v1/integrals",
    "integrals": "/v1/integrals/searches",
    "potentials": "/v1/potentials/searches",
    "numbers": "/v1/searches",
}
"""The path of each kind of question."""
_OF = {"psi1": "precession.psi1", "psi3": "precession.psi3"}


class Answer:
    """The answer of a study.

    Attributes
    ----------
    document
        The answer as the service tells it.
    """

    def __init__(self, document: Document) -> None:
        self.document = document

    def __getitem__(self, name: str) -> object:
        """Return a field of the document."""
        return self.document[name]

    def __repr__(self) -> str:
        return f"<{type(self).__name__.lower()}: {', '.join(self.document)}>"


@dataclass(frozen=True, slots=True)
class Hit:
    """Numbers that give what is wanted.

    Attributes
    ----------
    values
        The unknowns by their pointers, each with its error.
    window
        The number of the window of the motion.
    is_proved
        Within the errors there is a solution, and no other unless a trace is wanted; else doubles show one.
    """

    values: Mapping[str, Quantity]
    window: int
    is_proved: bool

    def __getitem__(self, name: str) -> Quantity:
        """Return an unknown by its pointer, or by the end of it; ``lam`` is λ."""
        wanted = "lambda" if name == "lam" else name
        return next(value for pointer, value in self.values.items() if f"/{pointer}".endswith(f"/{wanted}"))


class Numbers(Answer):
    """The numbers of a problem that give what is wanted."""

    @property
    def solutions(self) -> tuple[Hit, ...]:
        """The solutions, in the order of the first unknown."""
        return tuple(map(_hit, items(self.document["solutions"])))

    @property
    def is_complete(self) -> bool:
        """It is proved that there are no other solutions."""
        return self.document["rest"] == "proved_empty"

    @property
    def undecided(self) -> list[list[list[float]]]:
        """The boxes in which that is not proved, each with the two ends of every unknown."""
        return items(self.document["undecided"])

    def __repr__(self) -> str:
        rest = "no others" if self.is_complete else "others are not excluded"
        return f"<{len(self.solutions)} solutions; {rest}>"


def _hit(document: object) -> Hit:
    found = fields(document)
    values: dict[str, Quantity] = {}
    for pointer, value in fields(found["values"]).items():
        quantity = Quantity.read(value)
        if quantity is None:
            raise PolhodeError(f"the answer of the service has no number for {pointer}")
        values[pointer] = quantity
    return Hit(values, int(found["window"]), found["proof"] == "proved")


def search_document(
    base: Given, unknowns: Mapping[str, Sequence[Exact]], wanted: Mapping[str, Exact | None]
) -> Document:
    """Return the document that asks for numbers."""
    return {
        "base": read(base),
        "unknowns": [
            {"pointer": pointer, "interval": written(list(ends))} for pointer, ends in unknowns.items()
        ],
        "wanted": [
            {"of": _OF.get(name, name), "equals": written(value)}
            for name, value in wanted.items()
            if value is not None
        ],
    }


def lettered_document(
    potential: str,
    body: Mapping[str, Exact] | Sequence[Exact] | None,
    letters: Sequence[str],
    numbers: Mapping[str, Exact],
    **given: object,
) -> Document:
    """Return the document about a potential of which ``letters`` stand for any numbers.

    ``body`` is (A, B, C), or has some of the moments by their names; what is None is left out.
    """
    if not isinstance(body, Mapping):
        body = dict(zip("ABC", body or (), strict=False))
    parameters = {**dict.fromkeys(letters), **{name: written(each) for name, each in numbers.items()}}
    return {
        "body": written(body),
        "potential": {"type": "expression", "expression": potential, "parameters": parameters},
        **{name: value for name, value in given.items() if value is not None},
    }


def _answer(carrier: CarrierT, what: str, document: Document, seconds: float | None) -> Operation[Document]:
    """Return the answer to a question of a kind, at once or after the job that finds it has ended.

    Raises
    ------
    WrongArgumentError
        There is no such kind.
    RefusedError
        The document is none, or what it asks about has no answer.
    FailedError
        The job failed or was cancelled.
    UnfinishedError
        It took longer than ``seconds``; it goes on.
    """
    if what not in PATHS:
        raise WrongArgumentError(f"{what!r} is no kind of question; accepted are {', '.join(PATHS)}")
    terms = carrier.terms
    wait = WAIT_SECONDS if seconds is None else min(int(seconds), WAIT_SECONDS)
    headers = {"Prefer": f"wait={wait}"} if wait else {}
    reply = yield from ask(terms, "POST", PATHS[what], document, headers=headers)
    found: Document = json.loads(reply.content)
    if reply.status != _ACCEPTED:
        return found
    job = yield from follow(terms, f"/v1/jobs/{found['id']}", found, seconds=seconds, what="% of the answer")
    if job.get("state") != "succeeded":
        raise FailedError(job)
    return fields(job["result"])


class Questions(Generic[CarrierT]):
    """The studies that can be asked for."""

    carrier: CarrierT

    @operation
    def study(self, document: Given, *, seconds: float | None = None) -> Operation[Answer]:
        """Answer a question about integrals, potentials or numbers, a document with ``what`` or its file.

        Raises as :meth:`search`.
        """
        asked = read(document)
        what = str(asked.pop("what", None))
        answered = yield from _answer(self.carrier, what, asked, seconds)
        return Numbers(answered) if what == "numbers" else Answer(answered)

    @operation
    def integral(
        self,
        /,
        function: str,
        potential: str,
        *,
        body: Mapping[str, Exact] | Sequence[Exact] | None = None,
        letters: Sequence[str] = (),
        areas: int | None = None,
        relations: Sequence[str] = (),
        relation: bool = False,
        seconds: float | None = None,
        **parameters: Exact,
    ) -> Operation[Answer]:
        """Tell whether a function is an integral, with a proof or a counterexample.

        Parameters
        ----------
        function
            A formula in p, q, r, g1, g2, g3, the moments and the parameters.
        potential
            A formula in g1, g2, g3, the moments and the parameters.
        body
            (A, B, C), or some of them by name, as numbers or formulas such as ``"2*C"``; the others are
            letters.
        letters
            Parameters that have no number: the answer holds for all.
        areas
            0: of motions with I3 = 0 only.
        relations
            Polynomials that are 0 on the motions that are asked about.
        relation
            Ask whether the function being 0 is an invariant relation.
        seconds
            How long to wait for a job.
        """
        given = {"function": function, "areas": areas, "relations": list(relations), "relation": relation}
        document = lettered_document(potential, body, letters, parameters, **given)
        return Answer((yield from _answer(self.carrier, "integral", document, seconds)))

    @operation
    def search_integrals(
        self,
        /,
        potential: str,
        degree: tuple[int, int],
        *,
        body: Mapping[str, Exact] | Sequence[Exact] | None = None,
        letters: Sequence[str] = (),
        areas: int | None = None,
        seconds: float | None = None,
        **parameters: Exact,
    ) -> Operation[Answer]:
        """Find all polynomial integrals up to a degree in the velocities and one in γ.

        The rest is as :meth:`integral` takes it.
        """
        omega, gamma = degree
        asked = {"degree": {"omega": omega, "gamma": gamma}, "areas": areas}
        document = lettered_document(potential, body, letters, parameters, **asked)
        return Answer((yield from _answer(self.carrier, "integrals", document, seconds)))

    @operation
    def search_potentials(
        self, degree: int, *, body: tuple[Exact, Exact] | None = None, seconds: float | None = None
    ) -> Operation[Answer]:
        """Find all polynomial potentials up to a degree that admit planar motions.

        ``body`` is (A, C); without it every ratio is told at which there are more than at others.
        """
        document: Document = {"degree": degree}
        if body is not None:
            document["body"] = {"A": written(body[0]), "C": written(body[1])}
        return Answer((yield from _answer(self.carrier, "potentials", document, seconds)))

    @operation
    def search(
        self,
        base: Given,
        unknowns: Mapping[str, Sequence[Exact]],
        *,
        period: Exact | None = None,
        energy: Exact | None = None,
        trace: Exact | None = None,
        psi1: Exact | None = None,
        psi3: Exact | None = None,
        seconds: float | None = None,
    ) -> Operation[Numbers]:
        """Find the numbers of a problem with which its motion has what is wanted, all of them.

        Parameters
        ----------
        base
            A problem with a planar motion, or its file.
        unknowns
            Smallest and largest values of one or two numbers, by JSON pointers such as ``/motion/lambda``.
        period, energy, trace, psi1, psi3
            As many as there are unknowns; text such as ``"2*pi/3"`` is a formula. The last two are the
            precessions in a period, in radians.
        seconds
            How long to wait for a job.

        Raises
        ------
        RefusedError, FailedError, UnfinishedError
            As :meth:`atlas` raises them.
        """
        wanted = {"period": period, "energy": energy, "trace": trace, "psi1": psi1, "psi3": psi3}
        document = search_document(base, unknowns, wanted)
        return Numbers((yield from _answer(self.carrier, "numbers", document, seconds)))
