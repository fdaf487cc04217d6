"""What is found out about a potential, as documents: verdict, decomposition, nearest potential, windows."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from service.dynamics.body import RigidBody
from service.dynamics.inverse.curve_function import NoDecompositionError
from service.dynamics.inverse.decomposition import Decomposition, decompose
from service.dynamics.inverse.enclosures import Values
from service.dynamics.inverse.projection import nearest_admissible
from service.dynamics.inverse.terms import Terms
from service.dynamics.potentials.general_solution import Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.reduction.window import Window
from service.dynamics.verdict.verdict import Verdict

Document = dict[str, object]

W_POINTS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
G2_POINTS = (-0.9, -0.7, -0.5, -0.3, -0.1, 0.1, 0.3, 0.5, 0.7, 0.9)
"""Where a function without a formula is given by its values."""


@dataclass(frozen=True, slots=True)
class Points:
    """Where F and G are wanted by their values."""

    w: tuple[float, ...] = ()
    g2: tuple[float, ...] = ()


def verdict_document(verdict: Verdict, potential: Potential) -> Document:
    """Return the verdict without what takes further work: decomposition, nearest potential, motions."""
    counterexample, evidence = verdict.counterexample, verdict.evidence
    return {
        "verdict": verdict.verdict,
        "proof": verdict.proof,
        "energy": _energy(verdict),
        "counterexample": None
        if counterexample is None
        else {
            "g": [str(g) for g in counterexample.g],
            "residual": {"mid": counterexample.residual.mid, "rad": counterexample.residual.rad},
        },
        "evidence": None if evidence is None else asdict(evidence),
        "decomposition": None,
        "nearest": None,
        "motions": None,
        "warnings": [asdict(notice) for notice in potential.notices],
    }


def decomposition_document(body: RigidBody, potential: Potential, points: Points) -> Document | None:
    """Return F and G of an admissible potential, and their values at ``points``; None if it has none."""
    try:
        found = decompose(body, potential)
    except NoDecompositionError:
        return None
    at = Points(points.w or W_POINTS, points.g2 or G2_POINTS)
    quadrants = list(found.F)
    F = {q: found.F[q] or _numeric(at.w, found.F_at(q, at.w)) for q in quadrants}
    G = {q: found.G[q] or _numeric(at.g2, found.G_at(q, at.g2)) for q in quadrants}
    return {
        "F": _shared(F),
        "G": _shared(G),
        "reference_angle": found.reference_angle,
        "terms": _shared({q: _terms(terms) for q, terms in found.terms.items()}),
        "values": None if points == Points() else {q: _values(found, q, points) for q in quadrants},
    }


def nearest_document(body: RigidBody, potential: Potential) -> Document | None:
    """Return the admissible polynomial nearest to a polynomial, exact; None if V is not one."""
    nearest = nearest_admissible(body, potential)
    if nearest is None:
        return None
    distance = nearest.relative_squared_distance
    return {"expression": nearest.expression, "relative_squared_distance": str(distance)}


def window_document(window: Window) -> Document:
    """Return a window without its arcs."""
    return {
        "window": window.index,
        "kind": window.kind,
        "ends": list(window.ends),
        "g1": list(window.g1),
        "g2": list(window.g2),
    }


def _energy(verdict: Verdict) -> Document | None:
    if verdict.energy_formula is not None:
        return {"h": verdict.energy_formula}
    return None if verdict.energy_formulas is None else {"h": dict(verdict.energy_formulas)}


def _shared(by_quadrant: Mapping[Quadrant, object]) -> object:
    """Return what all quadrants have in common, or each quadrant's own."""
    first, *others = by_quadrant.values()
    return first if all(other == first for other in others) else dict(by_quadrant)


def _terms(terms: Terms | None) -> Document | None:
    if terms is None:
        return None
    lists = {"A": terms.A, "B": terms.B, "C": terms.C, "log": terms.log}
    return {"constant": str(terms.constant), **{name: [str(c) for c in of] for name, of in lists.items()}}


def _numeric(at: Sequence[float], values: Values) -> Document:
    """Return the values where there are any."""
    rows = [row for row in _rows(at, values) if row[1] is not None]
    error = max((row[2] for row in rows if row[2] is not None), default=0.0)
    return {"numeric": True, "points": [[x, value] for x, value, _ in rows], "error": error}


def _values(found: Decomposition, quadrant: Quadrant, points: Points) -> Document:
    return {
        "F": _rows(points.w, found.F_at(quadrant, points.w)),
        "G": _rows(points.g2, found.G_at(quadrant, points.g2)),
    }


def _rows(at: Sequence[float], values: Values) -> list[tuple[float, float | None, float | None]]:
    """Return argument, value and error; nulls where there is no value."""
    rows = zip(at, values.value.tolist(), values.error.tolist(), strict=True)
    return [(x, value, error) if abs(value) < float("inf") else (x, None, None) for x, value, error in rows]
