"""Converts verdict, decomposition, nearest potential, windows and plan to documents for clients.

A plan has remarks: reasons that make a job slow, less accurate, or refused. The seconds that are expected of
a tier come from a table of usual motions; what a motion has beyond those is seen on its curve. No remark is a
proof, and nothing is left out of a proof because of one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.discovery.known import known_cases
from service.dynamics.discovery.potential_search import ratios_that_admit
from service.dynamics.discovery.setting import FunctionTooLargeError, NotPolynomialError
from service.dynamics.exact import exact_number
from service.dynamics.formula.algebras.real import RealAlgebra
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.vanishing import vanishing_parts
from service.dynamics.inverse.decomposition import Decomposition, NoDecompositionError, Terms, decompose
from service.dynamics.inverse.named import Named, NamedFormulas
from service.dynamics.inverse.polynomials import as_polynomial
from service.dynamics.inverse.projection import nearest_admissible
from service.dynamics.inverse.section import Values
from service.dynamics.numerics import printed_error
from service.dynamics.potentials.families.general_solution import QUADRANTS, SIGNS, Quadrant
from service.dynamics.potentials.potential import Notice, Potential
from service.dynamics.problem import PlanarMotion, Problem, StateMotion
from service.dynamics.reduction.existence import CurveRange, Existence
from service.dynamics.reduction.geometry.tight_form import tight_form
from service.dynamics.reduction.window import Arc, Window, height
from service.dynamics.solution.dense_output import as_decimals
from service.dynamics.verdict.own_curve import InadmissibleMotionError
from service.dynamics.verdict.refutations import Counterexample, Jump
from service.dynamics.verdict.verdict import Verdict
from service.schemas.reading.documents import Document, Part

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
        "ratios": None,
        "motions": None,
        "existence": None,
        "plan": None,
        "formulas": None,
        "classical": None,
        "known_cases": known_cases_document(body, potential),
        "warnings": [asdict(notice) for notice in potential.notices],
    }


def known_cases_document(body: RigidBody, potential: Potential) -> list[Document]:
    """Return the cases with names that the body and the field are, each with its source."""
    return [asdict(case) for case in known_cases(body, potential)]


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
        "samples": problem.time.samples,
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


def ratios_document(body: RigidBody, potential: Potential, stated: Part) -> Document | None:
    """Return the ratios A/C for which a polynomial would be admissible, its formula being as ``stated``.

    None of a potential that is no polynomial.
    """
    if as_polynomial(potential) is None:
        return None
    text, parameters = potential.formula(), dict[str, Fraction]()
    if stated["type"] == "expression":
        text, given = stated["expression"], stated.get("parameters") or {}
        parameters = {name: exact_number(value) for name, value in given.items()}
    try:
        return ratios_that_admit(text, parameters, B=body.B, C=body.C).to_document()
    except (NotPolynomialError, FunctionTooLargeError):
        return None


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


FloatArray = NDArray[np.float64]

FINE, COARSE = 1e-10, 1e-6
"""Parts of the largest term down to which terms of a series of p² are counted: doubles have few more."""
USUAL = 128
"""Terms that a motion without narrow features does not need."""
MOST, MOST_OF_INTEGRAL = 4096, 256
"""Terms that are counted at most; each takes a value of V."""
PLACES = 257
"""Between the ends of a motion, where the signs of parts of a formula are looked at."""
NEXT_TO_POLE = 1e-9
INSIDE = 1e-6
"""Distance in g2 from an end of the motion at which a place is inside of it."""
UNUSUAL = frozenset({"pole_passage", "near_rest", "narrow_feature", "infinite_slope"})
"""Codes of remarks on motions that the accuracy table has none like: its times and errors are not theirs."""


def remarks_on(problem: Problem, window: Window) -> tuple[Notice, ...]:
    """Return what is remarkable about the quadrature of a planar motion; nothing of it is a refusal."""
    if problem.method == "integration" or not isinstance(problem.motion, PlanarMotion):
        return ()
    arc, *_ = window.arcs
    remarks = [*_of_potential(arc.loop.potential), *_of_ends(window), *_of_near_rests(arc), *_of_slopes(arc)]
    is_rough = bool(arc.poles) and not arc.loop.is_smooth_at_poles()
    if is_rough:
        remarks.append(
            Notice(
                "pole_passage",
                f"the motion passes a pole, where V or the motion is no power series (A/C or C/A is "
                f"{arc.loop.alpha}): its quadrature takes some hundred times as long as where it is one",
                "/motion",
            )
        )
    elif window.kind == "periodic":
        remarks += _of_width(arc)
    return tuple(remarks)


def _of_potential(potential: Potential) -> list[Notice]:
    if potential.has_formula:
        return []
    text = "V is an integral, of which each value takes as long as a hundred of a formula"
    return [Notice("integral", text, "/potential")]


def _of_ends(window: Window) -> list[Notice]:
    if window.kind == "periodic" or window.kind == "equilibrium":
        return []
    texts = {
        "collision": "p² grows without bound where the motion ends, after a finite time: later times are "
        "refused (motion_ended)",
        "pole": "the motion ends at a pole: later times may be refused (motion_ended)",
        "separatrix": "the motion approaches a rest for ever and has no period",
    }
    return [Notice(window.kind, texts[window.kind], "/motion")] if window.kind in texts else []


def _of_near_rests(arc: Arc) -> list[Notice]:
    """Return where p² nearly vanishes inside the motion."""
    return [
        Notice(
            "near_rest",
            f"at g2 = {height(arc.loop, near.v):.6g} p² nearly vanishes, within {float(near.reach):.2g} "
            "along the curve: the motion lingers there, and what doubles lose there it multiplies",
            "/motion",
        )
        for near in arc.slow
        if near.square > 0 and near.v > arc.lower and near.v < arc.upper
    ]


def _of_slopes(arc: Arc) -> list[Notice]:
    """Return where a part of the formula vanishes inside the motion that may make a slope of p² infinite."""
    potential, loop = arc.loop.potential, arc.loop
    if not potential.has_formula:
        return []
    turns = [height(loop, v) for v in (arc.lower, arc.upper, *arc.poles)]
    whole = (-1.0, 1.0) if arc.is_whole_loop else (min(turns), max(turns))
    places = np.linspace(whole[0] + INSIDE, whole[1] - INSIDE, PLACES)
    found = {_zero_on(part.part, places) for part in vanishing_parts(tight_form(potential.tape))}
    return [
        Notice(
            "infinite_slope",
            f"a root, a power or a logarithm is taken of what vanishes at g2 = {y:.6g}, which the motion "
            "passes: where a slope of p² is infinite the quadrature may tell no error, and be refused "
            '(accuracy_not_met); {"method": "integration"} needs no bound of it',
            "/potential",
        )
        for y in sorted(y for y in found if y is not None)
    ]


def _zero_on(part: Tape, places: FloatArray) -> float | None:
    """Return where a part that depends on g2 alone changes its sign between places, None if it does not."""
    nothing = np.zeros_like(places)
    with np.errstate(all="ignore"):
        values = np.broadcast_to(part.evaluate(RealAlgebra(), (nothing, places, nothing)), places.shape)
    (changes,) = np.nonzero(values[1:] * values[:-1] <= 0.0)
    return float(places[changes[0] : changes[0] + 2].mean()) if len(changes) else None


def _of_width(arc: Arc) -> list[Notice]:
    fine, coarse = terms_along(arc, FINE), terms_along(arc, COARSE)
    if fine <= USUAL:
        return []
    text = (
        f"p² has narrow features, or corners: its series along the motion has {fine} terms, or more, down to "
        f"{FINE:g} of the largest, and {coarse} down to {COARSE:g}; usual ones have {USUAL // 4}"
    )
    return [Notice("narrow_feature", text, "/potential")]


def terms_along(arc: Arc, part: float) -> int:
    """Return the number of terms of Chebyshev's series of p² along a motion, as far as terms are counted.

    Down to the last that is not below a ``part`` of the largest.
    """
    most = MOST if arc.loop.potential.has_formula else MOST_OF_INTEGRAL
    count, found = USUAL, USUAL
    while found > count // 2 and count < most:
        count *= 2
        sizes = _term_sizes(arc, count)
        (large,) = np.nonzero(sizes > part * sizes.max())
        found = int(large[-1]) + 1 if len(large) else 0
    return found


def _term_sizes(arc: Arc, count: int) -> FloatArray:
    """Return the sizes of terms of Chebyshev's series of p² along a motion, ``count`` + 1 of them."""
    low, high = float(arc.lower), float(arc.upper)
    v = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * np.arange(count + 1) / count)
    # A pole is a limit of places.
    v = np.where(np.abs(np.sin(v)) < NEXT_TO_POLE, v + NEXT_TO_POLE, v)
    P = arc.loop.radicand_real(np.sin(v), np.cos(v))
    terms = np.fft.rfft(np.concatenate([P, P[-2:0:-1]])).real / count
    return np.abs(terms)
