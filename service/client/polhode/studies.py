"""Studies: questions about integrals, potentials and numbers, answered at once or by a job."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from polhode.documents.problems import Document, Given, read
from polhode.documents.quantities import Exact, Quantity, fields, items, written
from polhode.errors import FailedError, PolhodeError, WrongArgumentError
from polhode.transport.carriers import CarrierT
from polhode.transport.exchange import ask, follow
from polhode.transport.steps import Operation

WAIT_SECONDS = 20
"""Seconds for which the service holds a request that a job answers; proxies may end longer ones."""
_ACCEPTED = 202
PATHS = {
    "integral": "/v1/integrals",
    "integrals": "/v1/integrals/searches",
    "potentials": "/v1/potentials/searches",
    "numbers": "/v1/searches",
}
"""Where each kind of question is asked."""
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
        Within the errors there is exactly one solution; else doubles show one.
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


def study(carrier: CarrierT, what: str, document: Document, seconds: float | None) -> Operation[Document]:
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
    job = yield from follow(terms, f"/v1/jobs/{found['id']}", found, seconds=seconds)
    if job.get("state") != "succeeded":
        raise FailedError(job)
    return fields(job["result"])
