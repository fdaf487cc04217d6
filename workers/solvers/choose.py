"""Chooses the solver of a motion by going through the tables; no other module does.

The window and the start of a planar motion are found in balls of sufficient precision. Both tables are read
from the top; the first row that fits holds. A family that does not take the motion, or declines it, leaves
it to the next one of its row.

Doubles of compiled code are the cheapest, and as exact as the tier of their kernel demands. Next come
elliptic functions, where the potential has three terms, then the way through poles that are not smooth, and
last the quadrature in balls, which has every motion.

No tier costs more than the next more accurate one: what its own kernel declines, it leaves to all that the
next one asks, in the same order.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from math import inf, isfinite
from types import MappingProxyType
from typing import Literal, TypeVar

from flint import arb, ctx

from service.dynamics.accuracy import TIER_TOLERANCES
from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.motion import EnclosureMethod, Motion
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import (
    Accuracy,
    ClassicalMotion,
    Method,
    PlanarMotion,
    Problem,
    StateMotion,
    Tier,
)
from service.dynamics.reduction.window import starting_point
from service.dynamics.reduction.windows import REDUCTION_BITS, choose_window, find_windows
from workers.solvers.assembly.families import Declined, Family, PeriodicPlace, Place
from workers.solvers.certified.certify import certify
from workers.solvers.certified.family import WayFamily
from workers.solvers.certified.validated.enclose import Start
from workers.solvers.classical.solve import place_motion, solve_classical
from workers.solvers.closed_form import ClosedFormFamily
from workers.solvers.compiled.family import CompiledFamily, CompiledTier, arc_in_doubles
from workers.solvers.errors import AccuracyNotMetError, PrecisionLostError
from workers.solvers.integration.solve import integrate_from
from workers.solvers.orbits.orbit import six_variables, starting_state
from workers.solvers.quadrature.family import QuadratureFamily
from workers.solvers.ways import is_plain

T = TypeVar("T")

HIGHEST_PRECISION = 16 * REDUCTION_BITS


def planar_start(body: RigidBody, potential: Potential, motion: PlanarMotion) -> tuple[float, ...]:
    """Return the initial state (p, q, r, g1, g2, g3) of a planar motion of any kind, periodic or not.

    Raises
    ------
    NoMotionError, SeveralWindowsError, NoSuchWindowError, StartOutsideWindowError
        The motion asked for is not there, or not the only one.
    """
    with ctx.workprec(REDUCTION_BITS):
        window = choose_window(find_windows(body, potential, motion), motion)
        return tuple(float(value) for value in starting_state(starting_point(window, motion)))


def proven_start(problem: Problem) -> tuple[RigidBody, Start]:
    """Return the body with all its moments and the state at t = 0 in balls: rational, or what formulas give.

    Raises
    ------
    DynamicsError
        As those who place a planar motion, or a classical one.
    """
    motion, body = problem.motion, problem.body
    if isinstance(motion, StateMotion):
        given = (*motion.omega, *motion.gamma)
        return body, lambda: [ball(value) for value in given]
    if isinstance(motion, ClassicalMotion):
        placed = place_motion(problem)
        return placed.body, lambda: placed.start.balls
    return body, partial(_planar_balls, problem, motion)


def _planar_balls(problem: Problem, motion: PlanarMotion) -> tuple[arb, ...]:
    # At the equator half of the bits are lost with the root of 1 − g1² − g3².
    precision = 2 * ctx.prec + REDUCTION_BITS
    with ctx.workprec(precision):
        windows = find_windows(problem.body, problem.potential, motion, precision=precision)
        start = starting_point(choose_window(windows, motion), motion)
        at = start.arc.loop.point(start.v)
        if not at.g2.is_finite():
            height = arb(0, arb((1 - at.g1 * at.g1 - at.g3 * at.g3).abs_upper()).sqrt())
            # What was asked of V without a height has no value either.
            at = at._replace(g2=height, P=start.arc.loop.radicand_at(at.g1, height, at.g3))
        p = -start.direction * at.P.sqrt() if start.direction else arb(0)
        return six_variables(start.arc.loop, at, p)


def with_enough_bits(problem: Problem, solve: Callable[[Problem, Place], T]) -> T:
    """Return ``solve`` of the problem's place, in balls of enough bits: doubled until its integrand is known.

    Raises
    ------
    NoMotionError, SeveralWindowsError, NoSuchWindowError, StartOutsideWindowError
        The motion asked for is not there, or not the only one.
    PrecisionLostError
        The highest precision is not enough.
    """
    motion = problem.motion
    if not isinstance(motion, PlanarMotion):
        raise DynamicsError("quadrature solves planar motions only", pointer="/motion/type")
    precision = REDUCTION_BITS
    while True:
        try:
            with ctx.workprec(precision):
                windows = find_windows(problem.body, problem.potential, motion, precision=precision)
                window = choose_window(windows, motion)
                return solve(problem, Place(window, starting_point(window, motion)))
        except PrecisionLostError:
            if precision >= HIGHEST_PRECISION:
                raise
            precision *= 2


Kind = Literal["any state", "periodic", "not periodic"]
"""The kind of a motion: integrated from any state; or planar, by the kind of its window."""
Grade = Literal["draft", "loose", "standard", "high", "certified"]
"""The tiers; ``loose`` is a tolerance that is looser than the promise of ``standard``."""
FamilyName = Literal["draft doubles", "standard doubles", "high doubles", "closed form", "way", "quadrature"]
Solver = FamilyName | Literal["integration"]
Enclosing = Literal["always", "where needed", "never"]
"""Whether samples are enclosed: ``where needed`` is where doubles do not keep the tolerance."""

COMPILED: Mapping[Solver, CompiledTier] = MappingProxyType(
    {"draft doubles": "draft", "standard doubles": "standard", "high doubles": "high"}
)
"""The tier of each kernel."""
FAMILIES: Mapping[FamilyName, Family] = MappingProxyType(
    {
        "draft doubles": CompiledFamily("draft"),
        "standard doubles": CompiledFamily("standard"),
        "high doubles": CompiledFamily("high"),
        "closed form": ClosedFormFamily(),
        "way": WayFamily(),
        "quadrature": QuadratureFamily(),
    }
)


@dataclass(frozen=True, slots=True)
class Row:
    """For motions of these kinds, by these methods, of these grades: who is asked, in this order."""

    kinds: tuple[Kind, ...]
    methods: tuple[Method, ...]
    grades: tuple[Grade, ...]
    asked: tuple[Solver, ...]

    @property
    def families(self) -> tuple[Family, ...]:
        """Return those among them that are asked with a window, which integration does not need."""
        return tuple(FAMILIES[name] for name in self.asked if name != "integration")


@dataclass(frozen=True, slots=True)
class EnclosureRow:
    """A rule for enclosing samples: for which methods and grades, when, and by what, in this order."""

    methods: tuple[Method, ...]
    grades: tuple[Grade, ...]
    when: Enclosing
    asked: tuple[EnclosureMethod, ...]


_PLANAR: tuple[Kind, ...] = ("periodic", "not periodic")
_ANY_METHOD: tuple[Method, ...] = ("auto", "quadrature", "integration", "both")
_FREE: tuple[Method, ...] = ("auto", "both")
"""Methods that leave the choice to the table."""
_ANY_GRADE: tuple[Grade, ...] = ("draft", "loose", "standard", "high", "certified")
_NOT_BY_DOUBLES: tuple[Grade, ...] = ("certified",)
_STANDARD: tuple[Grade, ...] = ("loose", "standard")
_BY_BALLS: tuple[Solver, ...] = ("way", "quadrature")
_DEARER: tuple[Solver, ...] = ("closed form", *_BY_BALLS)
_BY_HIGH: tuple[Solver, ...] = ("high doubles", *_DEARER)
_BY_STANDARD: tuple[Solver, ...] = ("standard doubles", *_BY_HIGH)
_BY_DRAFT: tuple[Solver, ...] = ("draft doubles", *_BY_STANDARD)

# fmt: off
FUNCTIONS_OF_TIME: tuple[Row, ...] = (
    #   motion              method             accuracy          asked, in this order
    Row(("any state",),     _ANY_METHOD,       _ANY_GRADE,       ("integration",)),
    Row(_PLANAR,            ("integration",),  _ANY_GRADE,       ("integration",)),
    Row(("not periodic",),  _ANY_METHOD,       _ANY_GRADE,       ("quadrature",)),
    Row(("periodic",),      ("quadrature",),   _ANY_GRADE,       _BY_BALLS),
    Row(("periodic",),      _FREE,             ("draft",),       _BY_DRAFT),
    Row(("periodic",),      _FREE,             _STANDARD,        _BY_STANDARD),
    Row(("periodic",),      _FREE,             ("high",),        _BY_HIGH),
    Row(("periodic",),      _FREE,             _NOT_BY_DOUBLES,  _DEARER),
)
"""The solvers that are asked for the motion as a function of time, by the first row that fits."""

ENCLOSURES: tuple[EnclosureRow, ...] = (
    #            method        accuracy         enclosed         asked, in this order
    EnclosureRow(_ANY_METHOD,  ("certified",),  "always",        ("elliptic", "integral")),
    EnclosureRow(_FREE,        _ANY_GRADE,      "where needed",  ("elliptic", "integral")),
    EnclosureRow(_ANY_METHOD,  _ANY_GRADE,      "never",         ()),
)
"""Whether samples are enclosed besides, and by what."""
# fmt: on


def grade_of(accuracy: Accuracy) -> Grade:
    """Return the grade of an accuracy: who is content with less than ``standard`` gets what is cheapest."""
    tier: Tier = accuracy.tier
    if tier == "standard" and accuracy.tolerance > TIER_TOLERANCES["standard"]:
        return "loose"
    return tier


@cache
def row_for(kind: Kind, method: Method, grade: Grade) -> Row:
    """Return the first row of FUNCTIONS_OF_TIME that fits; there is one for everything."""
    return next(
        row
        for row in FUNCTIONS_OF_TIME
        if kind in row.kinds and method in row.methods and grade in row.grades
    )


@cache
def enclosure_row_for(method: Method, grade: Grade) -> EnclosureRow:
    """Return the first row of ENCLOSURES that fits; there is one for everything."""
    return next(row for row in ENCLOSURES if method in row.methods and grade in row.grades)


QUICK_SPEED = 1024.0
"""Angular velocity from which on who misses an absolute tolerance is asked for a relative one at once: proven
digits, rounded to doubles, keep 1e-13 up to about here."""


def choose(problem: Problem, kind: Kind) -> Row:
    """Return who is asked for a motion of this kind, in the order of the table."""
    return row_for(kind, problem.method, grade_of(problem.accuracy))


def choose_enclosures(problem: Problem) -> EnclosureRow:
    """Return whether, and by what, the samples are enclosed."""
    return enclosure_row_for(problem.method, grade_of(problem.accuracy))


def compiled_tier(problem: Problem) -> CompiledTier | None:
    """Return the tier at which compiled doubles are asked first for a periodic motion; None if they are not.

    Those who compute many motions at once may then do so by compiled doubles alone, with the numbers of
    single ones, and leave to :func:`find_motion` what these decline.
    """
    return COMPILED.get(choose(problem, "periodic").asked[0])


def find_motion(problem: Problem) -> Motion:
    """Return the motion from the first of the table that has it, however large its error is.

    Raises
    ------
    NoMotionError, SeveralWindowsError, NoSuchWindowError, StartOutsideWindowError
        The motion asked for is not there, or not the only one.
    AccuracyNotMetError
        What the last one found contradicts its own claim, or the integration is worse than the tolerance.
    DynamicsError
        One class per cause; the families name theirs.
    """
    motion = problem.motion
    if isinstance(motion, ClassicalMotion):
        return solve_classical(problem, integrates=problem.method == "integration")
    if isinstance(motion, StateMotion):
        return integrate_from(problem, motion.omega, motion.gamma)
    if "integration" in choose(problem, "periodic").asked:
        state = planar_start(problem.body, problem.potential, motion)
        return integrate_from(problem, state[:3], state[3:])
    return with_enough_bits(problem, _ask_in_turn)


enclose = partial(certify, find_arc=arc_in_doubles)
"""Returns the enclosures of :func:`.certify`, which prove what compiled doubles find."""


def speed_in_doubles(problem: Problem) -> float | None:
    """Return about the largest |ω| of a planar motion; None if compiled doubles do not decide which it is."""
    if is_plain():
        return None
    # The compiler is loaded only where it is needed.
    from workers.solvers.compiled.solve import solve_spectral  # noqa: PLC0415

    motion = problem.motion_as(PlanarMotion)
    found = solve_spectral(problem.body, problem.potential, motion, tier="draft")
    speed = inf if found is None else float(found.bounds.largest)
    return speed if isfinite(speed) else None


def _ask_in_turn(problem: Problem, found: Place) -> Motion:
    is_periodic = found.window.kind == "periodic"
    place = PeriodicPlace(found.window, found.start) if is_periodic else found
    reached, last = inf, None
    for family in choose(problem, "periodic" if is_periodic else "not periodic").families:
        if not family.takes(problem, place):
            continue
        motion = family.solve(problem, place)
        if not isinstance(motion, Declined):
            return motion
        reached, last = motion.reached, motion.found
    if last is not None and isfinite(reached) and choose_enclosures(problem).when == "where needed":
        # Its samples will be enclosures, next to a function of time with the error that it showed.
        return last
    raise AccuracyNotMetError(reached, problem.tolerance)
