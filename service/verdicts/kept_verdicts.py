"""Writes a verdict as JSON, and reads the same verdict again."""

import json
from dataclasses import asdict
from fractions import Fraction
from typing import Any  # what was read from JSON

from service.dynamics.verdict.refutations.counterexample import Counterexample, DecimalBall
from service.dynamics.verdict.refutations.jumps import Jump
from service.dynamics.verdict.verdict import NumericEvidence, Verdict


def write_verdict(verdict: Verdict) -> str:
    """Return the verdict as JSON text."""
    point, formulas = verdict.counterexample, verdict.energy_formulas
    written = {
        "verdict": verdict.verdict,
        "proof": verdict.proof,
        "energy_formula": verdict.energy_formula,
        # As pairs: the order of the quadrants is part of it.
        "energy_formulas": None if formulas is None else list(formulas.items()),
        "counterexample": None
        if point is None
        else {"g": [str(g) for g in point.g], "residual": asdict(point.residual)},
        "jump": None if verdict.jump is None else asdict(verdict.jump),
        "evidence": None if verdict.evidence is None else asdict(verdict.evidence),
    }
    return json.dumps(written, separators=(",", ":"), allow_nan=False)


def read_verdict(text: str) -> Verdict:
    """Return the verdict that :func:`write_verdict` wrote."""
    found = json.loads(text)
    formulas, evidence = found["energy_formulas"], found["evidence"]
    return Verdict(
        found["verdict"],
        found["proof"],
        energy_formula=found["energy_formula"],
        energy_formulas=None if formulas is None else dict(formulas),
        counterexample=_counterexample(found["counterexample"]),
        jump=_jump(found["jump"]),
        evidence=None if evidence is None else NumericEvidence(**evidence),
    )


def _counterexample(written: dict[str, Any] | None) -> Counterexample | None:
    if written is None:
        return None
    g1, g2, g3 = map(Fraction, written["g"])
    return Counterexample((g1, g2, g3), DecimalBall(**written["residual"]))


def _jump(written: dict[str, Any] | None) -> Jump | None:
    if written is None:
        return None
    g1, g2, g3 = written["g"]
    return Jump(written["of"], (g1, g2, g3), written["radius"], DecimalBall(**written["jump"]))
