"""Chooses the solver of a motion by going through the tables; no other module does."""

from collections.abc import Sequence
from fractions import Fraction
from math import inf, isfinite

from service.dynamics.body import RigidBody
from service.dynamics.motion import EnclosureMethod, Motion
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import ClassicalMotion, PlanarMotion, Problem, StateMotion
from service.dynamics.sampling import sample_times
from workers.solvers.assembly.place import Declined, Place, periodic_place
from workers.solvers.certified.certify import Certified, certify
from workers.solvers.classical.solve import solve_classical
from workers.solvers.compiled.family import CompiledTier, arc_in_doubles
from workers.solvers.errors import AccuracyNotMetError, OwnUnitsNeededError
from workers.solvers.integration.solve import integrate_state
from workers.solvers.planar.start import planar_start, with_enough_bits
from workers.solvers.planar.table import (
    COMPILED,
    EnclosureRow,
    Kind,
    Row,
    enclosure_row_for,
    grade_of,
    row_for,
)
from workers.solvers.ways import is_plain

QUICK = 1024.0
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
    OwnUnitsNeededError
        The motion is quick, and a relative tolerance is allowed.
    AccuracyNotMetError
        What the last one found contradicts its own claim, or the integration is worse than the tolerance.
    DynamicsError
        One class per cause; the families name theirs.
    """
    motion = problem.motion
    if isinstance(motion, ClassicalMotion):
        return solve_classical(problem, integrates=problem.method == "integration")
    if isinstance(motion, StateMotion):
        return _integrate(problem, motion.omega, motion.gamma)
    if "integration" in choose(problem, "periodic").asked:
        state = planar_start(problem.body, problem.potential, motion)
        return _integrate(problem, state[:3], state[3:])
    return with_enough_bits(problem, _ask_in_turn)


def enclose(
    body: RigidBody,
    potential: Potential,
    motion: PlanarMotion | StateMotion | ClassicalMotion,
    times: Sequence[Fraction],
    bits: int,
    *,
    methods: Sequence[EnclosureMethod] = ("elliptic", "integral"),
    about_a_period: float | None = None,
) -> Certified:
    """Return the enclosures of :func:`.certify`, which prove what compiled doubles find."""
    return certify(
        body,
        potential,
        motion,
        times,
        bits,
        methods=methods,
        about_a_period=about_a_period,
        find_arc=arc_in_doubles,
    )


def speed_in_doubles(problem: Problem) -> float | None:
    """Return about the largest |ω| of a planar motion; None if compiled doubles do not decide which it is."""
    if is_plain():
        return None
    # The compiler is loaded only where it is needed.
    from workers.solvers.compiled.solve import solve_spectral  # noqa: PLC0415

    assert isinstance(problem.motion, PlanarMotion)
    found = solve_spectral(problem.body, problem.potential, problem.motion, tier="draft")
    speed = inf if found is None else float(found.bounds.largest)
    return speed if isfinite(speed) else None


def _ask_in_turn(problem: Problem, found: Place) -> Motion:
    is_periodic = found.window.kind == "periodic"
    place = periodic_place(found) if is_periodic else found
    reached, last = inf, None
    for family in choose(problem, "periodic" if is_periodic else "not periodic").families:
        if not family.takes(problem, place):
            continue
        motion = family.solve(problem, place)
        if not isinstance(motion, Declined):
            return motion
        if problem.accuracy.measure == "above 1" and isfinite(motion.reached) and reached == inf:
            speed = speed_in_doubles(problem)
            # Whoever has the motion in units of its own need not ask more precise solvers in vain.
            if speed is not None and speed >= QUICK:
                raise OwnUnitsNeededError(motion.reached, problem.tolerance, speed)
        reached, last = motion.reached, motion.found
    if last is not None and isfinite(reached) and choose_enclosures(problem).when == "where needed":
        # Its samples will be enclosures, next to a function of time with the error that it showed.
        return last
    raise AccuracyNotMetError(reached, problem.tolerance)


def _integrate(
    problem: Problem, omega: Sequence[Fraction | float], gamma: Sequence[Fraction | float]
) -> Motion:
    times = sample_times(problem.time, None)
    return integrate_state(
        problem.body,
        problem.potential,
        omega,
        gamma,
        times.doubles,
        tolerance=problem.tolerance,
        rests=times.rests,
    )
