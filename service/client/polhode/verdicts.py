"""The judgement of a service on a potential."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from polhode.showing import table_html


@dataclass(frozen=True, slots=True)
class Judgement:
    """Whether a potential admits planar motions, and how that is known.

    Parameters
    ----------
    document
        The whole answer, as docs/verdicts.md describes it.
    """

    document: Mapping[str, object]

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

    def __repr__(self) -> str:
        return f"<{self.verdict}, proof: {self.proof}>"

    def _repr_html_(self) -> str:
        return table_html(f"{self.verdict} (proof: {self.proof})", dict(self._facts()))

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
        for motion in _list(self.document.get("motions")):
            window = _section(motion) or {}
            g2 = " to ".join(f"{float(str(end)):.6g}" for end in _list(window.get("g2")))
            yield f"motion {window.get('window')}", f"{window.get('kind')}, γ₂ from {g2}"


def _list(value: object) -> Sequence[object]:
    return value if isinstance(value, list) else ()


def _text(value: object) -> str | None:
    return None if value is None else str(value)


def _section(value: object) -> Mapping[str, object] | None:
    return value if isinstance(value, Mapping) else None
