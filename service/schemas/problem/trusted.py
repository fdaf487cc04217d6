"""Makes problems of documents that are known to be valid, by the grammar and the constructors alone.

A document is validated once, where it is sent (:mod:`service.schemas.problem.problem`). It is stored and
handed on as it was sent, and whoever reads it then trusts it: children that examine and solve, and what shows
stored results. While a document is validated, its parts are made by the same functions. A number in a part is
a JSON number, a text, or exact already. A document that is not valid raises anything, or states another
problem.

Lists, sweeps and clients ask for the same body and potential many times over, at the same times: documents
that differ from one read before in λ alone are read without reading the rest again.
"""

import json
import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from threading import RLock
from typing import Any  # what was read from JSON

from service.cache import Cache
from service.dynamics.accuracy import CERTIFIED_BITS, TIER_TOLERANCES, cheapest_tier
from service.dynamics.body import RigidBody
from service.dynamics.classical.placement import place
from service.dynamics.errors import InvalidNumberError
from service.dynamics.exact import exact_number
from service.dynamics.potentials.families.coefficients import (
    gravity_potential,
    homogeneous_potential,
    rational_potential,
    require_rational_body,
)
from service.dynamics.potentials.families.general_solution import QUADRANTS
from service.dynamics.potentials.families.written import FormulaText, expression_potential, general_potential
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.problem import (
    Accuracy,
    ClassicalMotion,
    Output,
    PlanarMotion,
    Problem,
    Sign,
    Start,
    StartAtEquator,
    StartAtPoint,
    StartAtRest,
    StateMotion,
    TimeList,
    TimePeriods,
    Times,
    TimeSpan,
)
from service.schemas.reading.documents import Part

Motion = PlanarMotion | StateMotion | ClassicalMotion
Triple = tuple[Fraction, Fraction, Fraction]

OUTPUTS: tuple[Output, ...] = ("period", "gamma", "omega", "invariants", "orientation", "stability")
DEFAULT_OUTPUTS: tuple[Output, ...] = ("gamma", "omega")
DEFAULT_ACCURACY: Part = {"tier": "standard"}
DEFAULT_ANGLE = "pi/4"

ONE_AT_A_TIME = RLock()
"""Held by whoever computes in balls in a process of many threads, which has one precision for all of them.

A thread that leaves its precision sets back what it found, which is another thread's: that one would go on
with fewer bits than it asked for.
"""


def trusted_problem(document: Part) -> Problem:
    """Return the problem that a valid document states; raises what its constructors raise."""
    curve = curve_of(document)
    if curve is None:
        return _made(document)
    like = _CACHE.get(curve.rest)
    if like is None:
        like = _made(document)
        if not isinstance(like.potential, FormulaPotential):
            return like
        _CACHE.put(curve.rest, like)
    return on_curve(like, curve.field, exact_number(curve.number))


def _made(document: Part) -> Problem:
    body = body_of(document)
    return problem_of(document, body, potential_of(document["potential"], body))


def problem_of(document: Part, body: RigidBody, potential: Potential) -> Problem:
    """Return the problem of a document whose body and potential are made already."""
    return Problem(
        body,
        potential,
        motion_of(document["motion"], document["potential"]),
        times_of(document["time"]),
        accuracy_of(document.get("accuracy", DEFAULT_ACCURACY)),
        document.get("method", "auto"),
        outputs_of(document),
        document.get("accept", "proved"),
    )


def outputs_of(document: Part) -> tuple[Output, ...]:
    """Return what is to be computed, in our order."""
    wanted = document.get("outputs", DEFAULT_OUTPUTS)
    return tuple(name for name in OUTPUTS if name in wanted)


def body_of(document: Part) -> RigidBody:
    """Return the body of a document; that of a classical case follows from what its motion says."""
    body, motion = document["body"], document.get("motion")
    allows = body.get("allow_unphysical", False)
    if motion is None or motion["type"] != "classical":
        return RigidBody(exact_number(body["A"]), _if_any(body.get("B")), exact_number(body["C"]), allows)
    A, B, C = (_if_any(body.get(name)) for name in ("A", "B", "C"))
    with ONE_AT_A_TIME:
        return place(classical_motion(motion, document["potential"]), (A, B, C), allow_unphysical=allows).body


def potential_of(part: Part, body: RigidBody) -> Potential:
    """Return the potential of a body; raises what its family raises."""
    match part["type"]:
        case "expression":
            return expression_potential(part["expression"], parameters_of(part), body)
        case "gravity":
            return gravity_potential(*centre_of(part))
        case "rational":
            require_rational_body(body)
            return rational_potential(*(_numbers(part.get(name, ())) for name in ("a", "b", "c")))
        case "homogeneous":
            lists = {name: _numbers(part.get(name, ())) for name in ("A", "B", "C", "log")}
            return homogeneous_potential(body, **lists)
    angle = angle_text(part.get("reference_angle", DEFAULT_ANGLE))
    # The reference angle is looked at in balls.
    with ONE_AT_A_TIME:
        return general_potential(
            body, formula_of(part, "F"), formula_of(part, "G"), parameters_of(part), angle
        )


def parameters_of(part: Part) -> dict[str, Fraction]:
    """Return the numbers that names in formulas stand for."""
    return {name: exact_number(value) for name, value in part.get("parameters", {}).items()}


def centre_of(part: Part) -> Triple:
    """Return the factors of g1, g2 and g3 in a potential of the type gravity."""
    a, b, c = (exact_number(part.get(name, 0)) for name in ("a", "b", "c"))
    return a, b, c


def formula_of(part: Part, function: str) -> FormulaText:
    """Return the formula of F or G in a general potential: one, or one for each quadrant; 0 if left out."""
    given = {quadrant: part.get(f"{function}_{quadrant}") for quadrant in QUADRANTS}
    texts = {quadrant: text for quadrant, text in given.items() if text is not None}
    whole = part.get(function)
    return texts or ("0" if whole is None else whole)


def angle_text(given: int | float | str | Fraction) -> str:
    """Return the formula of a reference angle; a number becomes an exact ratio."""
    try:
        return str(exact_number(given))
    except InvalidNumberError:
        if isinstance(given, str):
            return given
        raise


def motion_of(part: Part, potential: Part) -> Motion:
    """Return the motion; that of a classical case knows the centre of its potential."""
    match part["type"]:
        case "planar":
            nu, sign = _if_any(part.get("nu")), part.get("g1_sign")
            window = part.get("window")
            return PlanarMotion(
                _if_any(part.get("lambda")),
                nu,
                _sign_of(nu) if sign is None else sign_of(sign),
                sign_of(part.get("g3_sign", 1)),
                None if window is None else int(exact_number(window)),
                _start(part.get("start")),
            )
        case "state":
            (p, q, r), (g1, g2, g3) = map(_numbers, (part["omega"], part["gamma"]))
            return StateMotion((p, q, r), (g1, g2, g3))
    return classical_motion(part, potential)


def classical_motion(part: Part, potential: Part) -> ClassicalMotion:
    """Return a motion of a classical case."""
    given = {name: part.get(name) for name in ("omega", "gamma")}
    omega, gamma = (None if of is None else (*map(_if_any, of),) for of in given.values())
    direction, sign, solution = (part.get(name) for name in ("direction", "sign", "solution"))
    return ClassicalMotion(
        part["case"],
        centre_of(potential),
        exact_number(part.get("phase") or 0),
        sign_of(direction or 1),
        sign_of(sign or 1),
        None if solution is None else int(exact_number(solution)),
        _if_any(part.get("p")),
        _if_any(part.get("energy")),
        _if_any(part.get("spin")),
        None if omega is None else (omega[0], omega[1], omega[2]),
        None if gamma is None else (gamma[0], gamma[1], gamma[2]),
    )


def times_of(part: Part) -> Times:
    """Return the times of the samples."""
    if "times" in part:
        return TimeList(_numbers(part["times"]))
    samples = int(exact_number(part["samples"]))
    if "periods" in part:
        return TimePeriods(exact_number(part["periods"]), samples)
    return TimeSpan(exact_number(part.get("start", 0)), exact_number(part["stop"]), samples)


def accuracy_of(part: Part) -> Accuracy:
    """Return what a tier promises, or the cheapest tier that keeps a tolerance.

    That is one without proofs, if possible. A budget has the tier that it has before it is turned into one.
    """
    if "tier" in part:
        tier, bits = part["tier"], part.get("bits") or CERTIFIED_BITS[0]
        return Accuracy(TIER_TOLERANCES[tier], tier, bits, measure="above 1")
    if "budget_seconds" in part:
        budget = float(exact_number(part["budget_seconds"]))
        return Accuracy(TIER_TOLERANCES["standard"], budget_seconds=budget, measure="above 1")
    is_relative = "relative" in part
    tolerance = float(exact_number(part["relative" if is_relative else "tolerance"]))
    cheapest = cheapest_tier(tolerance)
    tier = "high" if cheapest == "certified" else cheapest
    return Accuracy(tolerance, tier, measure="relative" if is_relative else "absolute")


def _start(part: Part | None) -> Start | None:
    if part is None:
        return None
    g2_sign, s_sign = (sign_of(part.get(name, 1)) for name in ("g2_sign", "s_sign"))
    match part.get("at"):
        case "equator":
            return StartAtEquator(s_sign)
        case "rest":
            return StartAtRest(g2_sign)
    return StartAtPoint(exact_number(part["g1"]), g2_sign, s_sign)


def _numbers(given: Iterable[Any]) -> tuple[Fraction, ...]:
    return tuple(map(exact_number, given))


def _if_any(given: int | float | str | Fraction | None) -> Fraction | None:
    return None if given is None else exact_number(given)


def sign_of(given: int | float | str | Fraction) -> Sign:
    """Return a sign."""
    return _sign_of(exact_number(given))


def _sign_of(number: Fraction | None) -> Sign:
    return -1 if number is not None and number < 0 else 1


# Documents that differ in λ alone.

CACHED = 64
"""Problems that are cached, each found by all of its document but the number that chooses the curve."""
LONGEST = 4096
"""Characters of what a cached problem is found by."""
_CACHE: Cache[str, Problem] = Cache(CACHED)
_NUMBERS = (str, int, float)
"""Exactly these: a number of another kind may know that no double is near it."""
_BARE_ZERO = re.compile(r"(?<![\d.])0\.0(?![\d])")
"""A 0.0 in a text may be such a number: 1e-400 is written so."""
_text = json.JSONEncoder(allow_nan=False, separators=(",", ":")).encode


@dataclass(frozen=True, slots=True)
class CurveNumber:
    """The number that chooses the curve of a planar motion, and the text of the rest of the document."""

    field: str
    """``lambda`` or ``nu``."""
    number: str | int | float
    rest: str


def curve_of(document: object) -> CurveNumber | None:
    """Return the number that chooses the curve; None if there is none, or the document is long."""
    motion = document.get("motion") if isinstance(document, dict) else None
    if not isinstance(document, dict) or not isinstance(motion, dict) or motion.get("type") != "planar":
        return None
    field = "lambda" if motion.get("nu") is None else "nu"
    number = motion.get(field)
    if not isinstance(number, _NUMBERS) or type(number) not in _NUMBERS:
        return None
    # Deep, or not of JSON: others say so.
    with suppress(RecursionError, TypeError, ValueError):
        rest = _text({**document, "motion": {**motion, field: "*"}})
        if len(rest) <= LONGEST and not ("0.0" in rest and _BARE_ZERO.search(rest)):
            return CurveNumber(field, number, rest)
    return None


def on_curve(like: Problem, field: str, number: Fraction) -> Problem:
    """Return the problem on another curve, which the ``number`` of a ``field`` chooses."""
    motion, potential = like.motion, like.potential
    if not isinstance(motion, PlanarMotion) or not isinstance(potential, FormulaPotential):
        raise TypeError("the problem is on no curve, or its potential has no formula")
    if field == "nu":
        motion = replace(motion, nu=number, g1_sign=_sign_of(number))
    else:
        motion = replace(motion, lambda_=number)
    # What is cached beside a formula while it is evaluated is for one problem.
    return replace(like, motion=motion, potential=potential.alone())
