"""The judgement of a service on a potential."""

from collections.abc import Mapping
from dataclasses import dataclass

from polhode.showing.notebooks import table_html


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

    def __repr__(self) -> str:
        return f"<{self.verdict}, proof: {self.proof}>"

    def _repr_html_(self) -> str:
        shown = ("energy", "counterexample", "nearest")
        facts = {name: self.document[name] for name in shown if self.document.get(name)}
        return table_html(f"{self.verdict} (proof: {self.proof})", facts)


def _text(value: object) -> str | None:
    return None if value is None else str(value)


def _section(value: object) -> Mapping[str, object] | None:
    return value if isinstance(value, Mapping) else None
