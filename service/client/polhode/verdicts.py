"""The judgement of a service on a potential."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from html import escape
from typing import Generic

from polhode.documents.problems import Document
from polhode.documents.quantities import fields, items
from polhode.drawing import table_html
from polhode.errors import PolhodeError
from polhode.transport.carriers import CarrierT, ThreadCarrier
from polhode.transport.exchange import ask_json
from polhode.transport.terms import Operation, operation

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
