"""Is L(V) = 0? Proved, refuted by a point, or undecided with the evidence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from math import ldexp
from typing import ClassVar, Literal

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.compatibility import residual_of
from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.general_solution import GeneralPotential, Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.counterexample import Counterexample, Survey, decimal_ball, survey
from service.dynamics.verdict.energy_formula import energy_formula, signed_energy_formulas
from service.dynamics.verdict.general_energy import energy_defect, energy_formulas
from service.dynamics.verdict.points import Point, fine_sphere_points, sphere_points
from service.dynamics.verdict.proof import prove

PRECISIONS = (128, 256, 512, 1024, 2048, 4096)
"""Bits of the enclosures, in turn: each doubling squares the smallest residual that is told from zero."""
LADDER_POINTS = 8
"""Points tried at each precision between the lowest and the highest: one in every octant."""
FIRST_POINTS = 2
"""Points tried before a proof: nearly every potential that is not admissible falls at the first."""

ENERGY_POINTS = 16
"""Points, two in every octant, where the energy of a potential given by an integral is checked."""


class UndefinedPotentialError(DynamicsError):
    """A potential without a value at any of the points tried."""

    code: ClassVar[str] = "undefined_potential"


@dataclass(frozen=True, slots=True)
class NumericEvidence:
    """L(V) was enclosed at ``points`` points with ``bits`` bits, and every enclosure has zero in it.

    ``largest_enclosure`` is the enclosure with the greatest absolute value, as
    ``"mid ± rad"`` in decimals.
    """

    points: int
    bits: int
    largest_enclosure: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is known of L(V) = 0, and from what.

    ``admissible`` with proof ``symbolic``: L(V) vanishes identically, wherever
    V has a value and two derivatives; ``energy_formula`` is then h in
    ``lambda`` (in ``nu`` for A = 2C), if it has a formula. ``admissible`` with
    proof ``numeric``: enclosed in tiny balls about zero everywhere tried, which
    is evidence and no proof. ``inadmissible``: a counterexample, rigorous.

    ``energy_formulas``: h on each quadrant (signs of g1 and g3), for a
    potential whose energy depends on the quadrant; otherwise None.
    """

    verdict: Literal["admissible", "inadmissible", "undecided"]
    proof: Literal["symbolic", "counterexample", "numeric"]
    energy_formula: str | None = None
    energy_formulas: Mapping[Quadrant, str] | None = None
    counterexample: Counterexample | None = None
    evidence: NumericEvidence | None = None


def decide(body: RigidBody, potential: Potential) -> Verdict:
    """Return the verdict on ``potential`` for ``body``; B plays no part.

    Only the values on the unit sphere matter: potentials that agree there get
    the same verdict.

    Raises
    ------
    EqualMomentsError
        A = C, where the equation loses its meaning.
    UndefinedPotentialError
        V has no finite value and derivatives at any of the points tried.
    """
    body.require_planar()
    points: Sequence[Point] = tuple(sphere_points())
    if isinstance(potential, GeneralPotential):
        return _decide_general(body, potential, points)
    first = survey(body, potential.tape, islice(points, FIRST_POINTS), bits=PRECISIONS[0])
    if first.counterexample is not None:
        return _refuted(first.counterexample)
    proof = prove(body, potential.tape)
    if proof is not None:
        if not first.defined:
            _require_defined(body, potential, points)
        formula = energy_formula(body, potential, proof)
        formulas = None if formula is not None else signed_energy_formulas(body, potential, proof)
        return Verdict("admissible", "symbolic", energy_formula=formula, energy_formulas=formulas)
    return _decide_numerically(body, potential, points)


def _decide_numerically(body: RigidBody, potential: Potential, points: Sequence[Point]) -> Verdict:
    """Climb the precisions until a point refutes, or zero is enclosed tightly all over."""
    first, *middle, last = PRECISIONS
    if not survey(body, potential.tape, points, bits=first).defined:
        points = _require_defined(body, potential, points)
    # All points at the ends of the ladder, a few on the way.
    stages = [(first, points), *((bits, points[:LADDER_POINTS]) for bits in middle), (last, points)]
    for bits, chosen in stages:
        found = survey(body, potential.tape, chosen, bits=bits)
        if found.counterexample is not None:
            return _refuted(found.counterexample)
    # Half of the bits may be lost to cancellation before the enclosures stop being evidence.
    # In doubles both sides are 0 at the highest precision: as strict as they can be.
    is_tiny = bool(found.defined) and found.relative <= ldexp(1.0, -last // 2)
    return Verdict("admissible" if is_tiny else "undecided", "numeric", evidence=_evidence(found))


def _decide_general(body: RigidBody, potential: GeneralPotential, points: Sequence[Point]) -> Verdict:
    """Confirm H = −F(w), which is proved for all F and G in :mod:`.general_energy`, by the values of V."""
    defects = (energy_defect(body, potential, point) for point in chain(points, fine_sphere_points()))
    defined = list(islice((defect for defect in defects if defect.is_finite()), ENERGY_POINTS))
    if not defined:
        raise UndefinedPotentialError(
            "the potential has no finite value at any of the points tried all over the unit sphere",
            pointer="/potential",
        )
    if all(defect.contains(0) for defect in defined):
        formulas = energy_formulas(body, potential)
        if formulas is None:
            return Verdict("admissible", "symbolic")
        if len(set(formulas.values())) > 1:
            return Verdict("admissible", "symbolic", energy_formulas=formulas)
        return Verdict("admissible", "symbolic", energy_formula=formulas["pp"])
    return _refute_general(body, potential, points)


def _refute_general(body: RigidBody, potential: GeneralPotential, points: Sequence[Point]) -> Verdict:
    """Look for a point with L(V) ≠ 0: the potential was made for another body."""
    largest, count = arb(0), 0
    with ctx.workprec(PRECISIONS[0]):
        for point in points:
            ball = residual_of(body, potential, point)
            if not ball.is_defined:
                continue
            count += 1
            residual = decimal_ball(ball.residual)
            if residual.excludes_zero:
                return _refuted(Counterexample(point, residual))
            largest = ball.residual if ball.residual.abs_upper() > largest.abs_upper() else largest
        found = decimal_ball(largest)
    evidence = NumericEvidence(count, PRECISIONS[0], f"{found.mid} ± {found.rad}")
    return Verdict("undecided", "numeric", evidence=evidence)


def _require_defined(body: RigidBody, potential: Potential, points: Sequence[Point]) -> Sequence[Point]:
    """Return points where V is defined, looking closer if there are none among ``points``."""
    fine = tuple(fine_sphere_points())
    for bits in (PRECISIONS[0], PRECISIONS[-1]):
        for candidates in (points, fine):
            defined = survey(body, potential.tape, candidates, bits=bits).defined
            if defined:
                return defined
    raise UndefinedPotentialError(
        "the potential has no finite value and derivatives at any of "
        f"{len(points) + len(fine)} points all over the unit sphere",
        pointer="/potential",
    )


def _refuted(counterexample: Counterexample) -> Verdict:
    return Verdict("inadmissible", "counterexample", counterexample=counterexample)


def _evidence(found: Survey) -> NumericEvidence:
    return NumericEvidence(
        points=len(found.defined),
        bits=found.bits,
        largest_enclosure=f"{found.largest.mid} ± {found.largest.rad}",
    )
