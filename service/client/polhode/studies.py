"""The judgement of a service on a potential; studies: questions about integrals, potentials and numbers.

Studies are answered at once or by a job.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from typing import Generic

from polhode.documents.problems import Document, Given, read
from polhode.documents.quantities import Exact, Quantity, fields, items, written
from polhode.drawing import table_html
from polhode.errors import FailedError, PolhodeError, WrongArgumentError
from polhode.transport.carriers import CarrierT, ThreadCarrier
from polhode.transport.exchange import ask, ask_json, follow
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


_TYPESET = ("V", "h", "F", "G", "nearest")
"""The equations that a verdict is shown with, in this order."""


class Judgement(Generic[CarrierT]):
    """Whether a potential admits planar motions, and how that is known.

    Attributes
    ----------
    document
        The whole answer, as docs/verdicts.md describes it.
    question
        The document that it answers.
    """

    def __init__(self, carrier: CarrierT, document: Document, question: Document) -> None:
        self.carrier, self.document, self.question = carrier, document, question
        self._equations: dict[str, list[str]] | None = None

    @property
    def verdict(self) -> str | None:
        """``admissible`` and ``inadmissible`` are proved, ``undecided`` is neither."""
        return _text(self.document.get("verdict"))

    @property
    def proof(self) -> str | None:
        """``symbolic``, ``counterexample``, or ``numeric``, which proves nothing."""
        return _text(self.document.get("proof"))

    @property
    def is_admissible(self) -> bool:
        """It is proved that the potential admits planar motions."""
        return self.verdict == "admissible"

    @property
    def counterexample(self) -> Mapping[str, object] | None:
        """A point of the sphere ``g``, and ``residual``: an enclosure without 0; None unless inadmissible."""
        return _section(self.document.get("counterexample"))

    @property
    def energy(self) -> Mapping[str, object] | None:
        """The energy as a function of λ."""
        return _section(self.document.get("energy"))

    @property
    def decomposition(self) -> Mapping[str, object] | None:
        """The two free functions F and G of an admissible potential."""
        return _section(self.document.get("decomposition"))

    @property
    def nearest(self) -> Mapping[str, object] | None:
        """The nearest admissible polynomial to one that is not."""
        return _section(self.document.get("nearest"))

    @property
    def plan(self) -> Mapping[str, object] | None:
        """A job's plan for the whole problem; ``tiers`` has the expected time and error of each tier."""
        return _section(self.document.get("plan"))

    @property
    def motions(self) -> Sequence[Mapping[str, object]]:
        """The windows of the motions for the λ or ν that was asked for; empty without one."""
        return [fields(each) for each in _list(self.document.get("motions"))]

    @property
    def classical(self) -> Mapping[str, object] | None:
        """The classical and integrable cases that a state in a field of gravity lies on, or is near."""
        return _section(self.document.get("classical"))

    @property
    def known_cases(self) -> Sequence[Mapping[str, object]]:
        """The cases of the heavy body that have names and that the problem is, with their sources."""
        return [fields(each) for each in _list(self.document.get("known_cases"))]

    @operation
    def latex(self) -> Operation[Mapping[str, Sequence[str]]]:
        """Return the equations as LaTeX, by name: V, h, F, G, and those of docs/formulas.md.

        One that differs between quadrants comes several times; those with names of parameters come first.
        """
        return (yield from self._typeset())

    def _typeset(self) -> Operation[dict[str, list[str]]]:
        if self._equations is None:
            path = "/v1/validations?formulas=latex"
            answer = yield from ask_json(self.carrier.terms, "POST", path, self.question)
            found: dict[str, list[str]] = {}
            for each in sorted(items(answer["formulas"]), key=lambda each: not each["named"]):
                found.setdefault(each["name"], []).append(each["formats"]["latex"])
            self._equations = found
        return self._equations

    def _lines(self) -> list[str]:
        """Return the equations that are shown; none where the service cannot be asked."""
        if self._equations is None and isinstance(self.carrier, ThreadCarrier):
            try:
                self.carrier.run(partial(Judgement._typeset, self)())
            except PolhodeError:
                return []
        known = self._equations or {}
        return [known[name][0] for name in _TYPESET if name in known]

    def __repr__(self) -> str:
        return f"<{self.verdict}, proof: {self.proof}>"

    def _repr_latex_(self) -> str | None:
        aligned = r" \\ ".join(line.replace(" = ", " &= ", 1) for line in self._lines())
        return rf"$\begin{{aligned}} {aligned} \end{{aligned}}$" if aligned else None

    def _repr_html_(self) -> str:
        table = table_html(f"{self.verdict} (proof: {self.proof})", dict(self._facts()))
        # Notebooks typeset what is between dollars.
        return table + "".join(f"<p>${escape(line)}$</p>" for line in self._lines())

    def _facts(self) -> Iterator[tuple[str, str]]:
        if (energy := self.energy) is not None:
            h, variable = energy.get("h_named") or energy.get("h"), energy.get("variable")
            yield "energy", f"h({variable}) = {h}" if h else "not the same formula in all quadrants"
        if (point := self.counterexample) is not None:
            residual = _section(point.get("residual")) or {}
            yield "counterexample", f"γ = ({', '.join(map(str, _list(point.get('g'))))})"
            yield str(point.get("kind")).replace("_", " "), f"{residual.get('mid')} ± {residual.get('rad')}"
        if (nearest := self.nearest) is not None:
            yield "nearest admissible", str(nearest.get("expression"))
        if (evidence := _section(self.document.get("evidence"))) is not None:
            yield "what is missing", str(evidence.get("doubt"))
        for window in self.motions:
            g2 = " to ".join(f"{float(str(end)):.6g}" for end in _list(window.get("g2")))
            yield f"motion {window.get('window')}", f"{window.get('kind')}, γ₂ from {g2}"


def _list(value: object) -> Sequence[object]:
    return value if isinstance(value, list) else ()


def _text(value: object) -> str | None:
    return None if value is None else str(value)


def _section(value: object) -> Mapping[str, object] | None:
    return value if isinstance(value, Mapping) else None
