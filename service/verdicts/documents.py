"""Converts verdict, decomposition, nearest potential and windows to documents for clients."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from flint import arb

from service.dynamics.body import RigidBody
from service.dynamics.bounds import printed_error
from service.dynamics.inverse.curve_function import NoDecompositionError
from service.dynamics.inverse.decomposition import Decomposition, decompose
from service.dynamics.inverse.enclosures import Values
from service.dynamics.inverse.named import Named, NamedFormulas
from service.dynamics.inverse.projection import nearest_admissible
from service.dynamics.inverse.terms import Terms
from service.dynamics.potentials.families.general_solution import QUADRANTS, SIGNS, Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Problem, StateMotion, TimeList
from service.dynamics.reduction.existence import CurveRange, Existence
from service.dynamics.reduction.window import Window
from service.dynamics.solution.ball_columns import as_decimals
from service.dynamics.verdict.own_curve import InadmissibleMotionError
from service.dynamics.verdict.refutations.counterexample import Counterexample
from service.dynamics.verdict.refutations.jumps import Jump
from service.dynamics.verdict.verdict import Verdict
from service.verdicts.remarks import remarks_on

Document = dict[str, object]

NAMELESS = NamedFormulas()
W_POINTS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
G2_POINTS = (-0.9, -0.7, -0.5, -0.3, -0.1, 0.1, 0.3, 0.5, 0.7, 0.9)
"""Arguments at which a function without a formula is tabulated."""


@dataclass(frozen=True, slots=True)
class Points:
    """Arguments at which the client wants values of F and G."""

    w: tuple[float, ...] = ()
    g2: tuple[float, ...] = ()


def verdict_document(body: RigidBody, verdict: Verdict, potential: Potential) -> Document:
    """Return the verdict alone, without decomposition, nearest potential and motions."""
    evidence = verdict.evidence
    return {
        "verdict": verdict.verdict,
        "proof": verdict.proof,
        "energy": energy_document(body, verdict),
        "counterexample": _counterexample(verdict.counterexample, verdict.jump),
        "evidence": None if evidence is None else asdict(evidence),
        "decomposition": None,
        "nearest": None,
        "motions": None,
        "existence": None,
        "plan": None,
        "formulas": None,
        "classical": None,
        "warnings": [asdict(notice) for notice in potential.notices],
    }


def _counterexample(point: Counterexample | None, jump: Jump | None) -> Document | None:
    if point is not None:
        residual = {"mid": point.residual.mid, "rad": point.residual.rad}
        return {"kind": "residual", "g": [str(g) for g in point.g], "radius": None, "residual": residual}
    if jump is not None:
        residual = {"mid": jump.jump.mid, "rad": jump.jump.rad}
        return {"kind": f"jump_of_{jump.of}", "g": list(jump.g), "radius": jump.radius, "residual": residual}
    return None


def motion_counterexample(error: InadmissibleMotionError) -> Document:
    """Return the point that refutes a motion."""
    residual = {"mid": error.residual.mid, "rad": error.residual.rad}
    return {"kind": "residual", "g": list(error.g), "radius": error.radius, "residual": residual}


def plan_document(problem: Problem, window: Window | None) -> Document:
    """Return the plan of a job for ``problem``; ``window`` is that of its planar motion.

    The expected seconds, the tiers and the stored solution, which depend on an installation, are left out;
    with a budget, the tier is the one before the budget has been turned into a tier.
    """
    is_state = isinstance(problem.motion, StateMotion)
    method = problem.method if problem.method != "auto" else "integration" if is_state else "quadrature"
    return {
        "method": method,
        "tier": problem.accuracy.tier,
        "tolerance": problem.tolerance,
        "samples": len(problem.time.times) if isinstance(problem.time, TimeList) else problem.time.samples,
        "window": None if window is None else window_document(window),
        "remarks": [] if window is None else [asdict(notice) for notice in remarks_on(problem, window)],
        "expected_seconds": None,
        "tiers": [],
        "solution": None,
    }


def decomposition_of(body: RigidBody, potential: Potential) -> Decomposition | None:
    """Return F and G of an admissible potential, None if it has none."""
    try:
        return decompose(body, potential)
    except NoDecompositionError:
        return None


def decomposition_document(found: Decomposition, named: NamedFormulas, points: Points) -> Document:
    """Return F and G with their names, and their values at ``points``."""
    at = Points(points.w or W_POINTS, points.g2 or G2_POINTS)
    quadrants, named_F, named_G = list(found.F), named.F or {}, named.G or {}
    parts: dict[Quadrant, Document] = {}
    for q in quadrants:
        F, G = found.F[q], found.G[q]
        parts[q] = {
            "F": _formula(F, named_F.get(q)) if F else _numeric(at.w, found.F_at(q, at.w)),
            "G": _formula(G, named_G.get(q)) if G else _numeric(at.g2, found.G_at(q, at.g2)),
            "terms": _terms(found.terms[q]),
        }
    return {
        "F": _shared([found.F[q] for q in quadrants]),
        "F_named": _shared([named_F.get(q) for q in quadrants]),
        "G": _shared([found.G[q] for q in quadrants]),
        "G_named": _shared([named_G.get(q) for q in quadrants]),
        "reference_angle": found.reference_angle,
        "terms": _shared([parts[q]["terms"] for q in quadrants]),
        "quadrants": {q: parts.get(q) for q in QUADRANTS},
        "values": None if points == Points() else {q: _values(found, q, points) for q in quadrants},
    }


def energy_document(
    body: RigidBody, verdict: Verdict, found: Decomposition | None = None, named: NamedFormulas = NAMELESS
) -> Document | None:
    """Return h of an admissible potential, by its values where it has no formula; None if it is not known."""
    formulas: Mapping[Quadrant, str] = verdict.energy_formulas or {}
    if verdict.energy_formula is not None:
        formulas = dict.fromkeys(QUADRANTS if found is None else found.F, verdict.energy_formula)
    if not formulas and found is None:
        return None
    of_names = named.energies or dict.fromkeys(formulas, named.energy)
    in_nu = body.A == 2 * body.C
    quadrants: dict[Quadrant, Document] = {}
    for q in formulas if found is None else found.F:
        if q in formulas:
            quadrants[q] = _formula(formulas[q], of_names.get(q))
        elif found is not None:
            curves = [SIGNS[q][0] * curve if in_nu else curve for curve in W_POINTS]
            quadrants[q] = _numeric(curves, found.energy_at(q, curves))
    return {
        "h": verdict.energy_formula,
        "h_named": named.energy,
        "variable": "nu" if in_nu else "lambda",
        "quadrants": {q: quadrants.get(q) for q in QUADRANTS},
    }


def nearest_document(
    body: RigidBody, potential: Potential, named: Named | None, highest: int | None = None
) -> Document | None:
    """Return the admissible polynomial nearest to a polynomial, exact; None if V is not one.

    The search goes up to the degree ``highest``, by default the degree of V plus 6.
    """
    nearest = nearest_admissible(body, potential, highest=highest)
    if nearest is None:
        return None
    degree = nearest.space.degree
    return {
        "expression": nearest.expression,
        "expression_named": None if named is None else named.nearest(body, nearest, potential),
        "relative_squared_distance": str(nearest.relative_squared_distance),
        "degree": degree,
        "space": {
            "description": f"all polynomials in g1, g2, g3 that on the sphere g1^2 + g2^2 + g3^2 = 1 have a "
            f"degree of at most {degree} and satisfy the compatibility equation identically",
            "dimension": nearest.space.dimension,
        },
        "by_degree": [
            {"degree": n, "relative_squared_distance": str(distance)}
            for n, distance in enumerate(nearest.distances)
        ],
    }


def window_document(window: Window) -> Document:
    """Return a window without its arcs."""
    return {
        "window": window.index,
        "kind": window.kind,
        "ends": list(window.ends),
        "g1": list(window.g1),
        "g2": list(window.g2),
    }


def _shared(of_quadrants: Sequence[object]) -> object:
    """Return what all quadrants have in common, None if they differ."""
    first = next(iter(of_quadrants), None)
    return first if all(other == first for other in of_quadrants) else None


def _formula(text: str, named: str | None) -> Document:
    return {"formula": text, "named": named, "numeric": False, "points": [], "error": None}


def _terms(terms: Terms | None) -> Document | None:
    if terms is None:
        return None
    lists = {"A": terms.A, "B": terms.B, "C": terms.C, "log": terms.log}
    return {"constant": str(terms.constant), **{name: [str(c) for c in of] for name, of in lists.items()}}


def _numeric(at: Sequence[float], values: Values) -> Document:
    """Return the values where there are any."""
    rows = [row for row in _rows(at, values) if row[1] is not None]
    error = max((row[2] for row in rows if row[2] is not None), default=0.0)
    points = [[x, value] for x, value, _ in rows]
    return {"formula": None, "named": None, "numeric": True, "points": points, "error": error}


def _values(found: Decomposition, quadrant: Quadrant, points: Points) -> Document:
    return {
        "F": _rows(points.w, found.F_at(quadrant, points.w)),
        "G": _rows(points.g2, found.G_at(quadrant, points.g2)),
    }


def _rows(at: Sequence[float], values: Values) -> list[tuple[float, float | None, float | None]]:
    """Return argument, value and error; nulls where there is no value."""
    rows = zip(at, values.value.tolist(), values.error.tolist(), strict=True)
    return [
        (x, value, printed_error(value, error)) if abs(value) < float("inf") else (x, None, None)
        for x, value, error in rows
    ]


def existence_document(existence: Existence) -> Document:
    """Return the values of λ, or of nu, for which motions exist."""
    found = [_stretch(each) for each in existence.motions]
    return {
        "lambda": found if existence.name == "lambda" else None,
        "nu": found if existence.name == "nu" else None,
        "undecided": [_stretch(each) for each in existence.undecided],
    }


def _stretch(stretch: CurveRange) -> Document:
    return {"from": _ball(stretch.lower), "to": _ball(stretch.upper)}


def _ball(ball: arb | None) -> Document | None:
    if ball is None:
        return None
    mid, rad = as_decimals(ball)
    return {"mid": mid, "rad": rad}
