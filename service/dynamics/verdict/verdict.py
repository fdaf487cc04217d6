"""Decides whether L(V) = 0: proved, refuted by a point, or undecided with the evidence.

First it is checked that the potential, and every part of its formula, has a value somewhere on the sphere.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import ClassVar, Literal

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.equations.compatibility import residual_of
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.potentials.families.general_solution import GeneralPotential, Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.piecewise import (
    PiecewiseFindings,
    TooManyPiecesError,
    examine_pieces,
    find_pieces,
    lines_of,
)
from service.dynamics.verdict.proofs.energy_terms import (
    OctantTerms,
    energy_defect,
    energy_formulas,
    energy_terms,
    formula_of,
    signed_formulas_of,
)
from service.dynamics.verdict.proofs.power_sums import CurveEnergy, prove_power_sum
from service.dynamics.verdict.proofs.proof import Proof, prove
from service.dynamics.verdict.refutations import Counterexample, Jump, decimal_ball, survey
from service.dynamics.verdict.sphere.boxes import Point, fine_sphere_points, sphere_points
from service.dynamics.verdict.sphere.switches import find_switches

VALUE_PRECISIONS = (128, 4096)
"""Bits of the enclosures that decide whether there is a value."""


class UndefinedPotentialError(DynamicsError):
    """A potential, or a part of its formula, without a value at any of the points tried."""

    code: ClassVar[str] = "undefined_potential"


def require_all_parts(body: RigidBody, potential: Potential, is_late: Callable[[], bool]) -> None:
    """Raise UndefinedPotentialError if a part of the formula that 0 takes away has a value nowhere.

    0·x is 0 also where x is infinite; but what has no value anywhere has none times 0.
    """
    whole = compile_tape(potential.tree, formally=False)
    if whole == potential.tape:
        return
    defined_points(body, whole, VALUE_PRECISIONS, is_late)


def defined_points(
    body: RigidBody, tape: Tape, precisions: Sequence[int], is_late: Callable[[], bool]
) -> Sequence[Point]:
    """Return points where a formula has a value and two derivatives.

    Raises
    ------
    UndefinedPotentialError
        There are none among many points all over the sphere, and in the boxes where roots and logarithms
        may have a value.
    """
    usual = tuple(sphere_points())
    count = 0
    for bits in (precisions[0], precisions[-1]):
        for points in chain((usual,), _closer(tape, is_late)):
            count += len(points)
            found = survey(body, tape, points, bits=bits).defined
            if found:
                return found
            if is_late():
                break
    raise UndefinedPotentialError(
        "the potential, or a part of it, has no finite value and derivatives at any of "
        f"{count} points all over the unit sphere",
        pointer="/potential",
    )


def _closer(tape: Tape, is_late: Callable[[], bool]) -> Iterator[tuple[Point, ...]]:
    try:
        pieces = find_pieces(find_switches(tape), is_late)
        yield tuple(point for known in pieces.points.values() for point in known)
    except TooManyPiecesError:
        pass
    yield tuple(fine_sphere_points())


PRECISIONS = (128, 256, 512, 1024, 2048, 4096)
"""Successive bits of the enclosures: each doubling squares the smallest residual distinguished from zero."""
LADDER_POINTS = 8
"""Points tried at each precision between the lowest and the highest: one in every octant."""
FIRST_POINTS = 2
"""Points tried before a proof: nearly every potential that is not admissible falls at the first."""

ENERGY_POINTS = 16
"""Points, two in every octant, where the energy of a potential given by an integral is checked."""


@dataclass(frozen=True, slots=True)
class NumericEvidence:
    """L(V) was enclosed at ``points`` points with ``bits`` bits, and every enclosure has zero in it.

    ``largest_enclosure`` is the enclosure with the greatest absolute value, as
    ``"mid ± rad"`` in decimals; ``doubt`` is what is not proved.
    """

    points: int
    bits: int
    largest_enclosure: str
    doubt: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on L(V) = 0, with its proof or evidence.

    ``admissible`` means proved: L(V) vanishes identically, wherever V has a value and two derivatives, and
    where curves cross a kink of V, V and the energy are the same on both sides. ``energy_formula`` is then h
    in ``lambda`` (in ``nu`` for A = 2C), if it has a formula. ``inadmissible``: refuted by
    ``counterexample``, a point where L(V) ≠ 0, or by ``jump``, a kink where V or the energy jumps; both are
    rigorous. ``undecided``: ``evidence`` has what is not proved, and how closely zero was enclosed.

    ``energy_formulas``: h on each quadrant (signs of g1 and g3), for a
    potential whose energy depends on the quadrant; otherwise None.
    """

    verdict: Literal["admissible", "inadmissible", "undecided"]
    proof: Literal["symbolic", "counterexample", "numeric"]
    energy_formula: str | None = None
    energy_formulas: Mapping[Quadrant, str] | None = None
    counterexample: Counterexample | None = None
    jump: Jump | None = None
    evidence: NumericEvidence | None = None


def decide(body: RigidBody, potential: Potential, is_late: Callable[[], bool] = lambda: False) -> Verdict:
    """Return the verdict on ``potential`` for ``body``; B plays no part.

    Only the values on the unit sphere matter: potentials that agree there get
    the same verdict, which is about the formula as it was typed. When it ``is_late``, what is not decided
    stays undecided.

    Raises
    ------
    EqualMomentsError
        A = C, where the equation loses its meaning.
    UndefinedPotentialError
        V, or a part of its formula, has no finite value and derivatives at any of the points tried.
    """
    body.require_planar()
    potential = potential.as_stated
    points: Sequence[Point] = tuple(sphere_points())
    if isinstance(potential, GeneralPotential):
        return _decide_general(body, potential, points, is_late)
    require_all_parts(body, potential, is_late)
    first = survey(body, potential.tape, islice(points, FIRST_POINTS), bits=PRECISIONS[0])
    if first.counterexample is not None:
        return _refuted(first.counterexample)
    proof = prove(body, potential.tape)
    sums = prove_power_sum(body, potential.tape) if proof is None else None
    found = examine_pieces(body, potential.tape, proof is not None or sums is not None, is_late)
    if found is not None and found.is_refuted:
        return Verdict("inadmissible", "counterexample", counterexample=found.counterexample, jump=found.jump)
    terms = _terms(body, proof, sums, found)
    if terms is not None and (found is None or found.doubt is None):
        if not first.defined:
            defined_points(body, potential.tape, PRECISIONS, is_late)
        return _proved(body, potential, terms)
    doubt = "that the compatibility equation holds identically"
    if found is not None:
        points, doubt = (*points, *found.points), found.doubt or doubt
    return _decide_numerically(body, potential, points, doubt, is_late)


def _terms(
    body: RigidBody, proof: Proof | None, sums: CurveEnergy | None, found: PiecewiseFindings | None
) -> OctantTerms | None:
    """Return the terms of the energy by what has proved L(V) = 0, None if nothing has."""
    if proof is not None:
        return energy_terms(body, proof)
    if sums is not None:
        return sums.by_octant()
    return None if found is None else found.terms


def _proved(body: RigidBody, potential: Potential, terms: OctantTerms) -> Verdict:
    formula = formula_of(body, potential, terms)
    formulas = None if formula is not None else signed_formulas_of(body, potential, terms)
    return Verdict("admissible", "symbolic", energy_formula=formula, energy_formulas=formulas)


def _decide_numerically(
    body: RigidBody, potential: Potential, points: Sequence[Point], doubt: str, is_late: Callable[[], bool]
) -> Verdict:
    """Climb the precisions until a point refutes, or time is over."""
    first, *middle, last = PRECISIONS
    found = survey(body, potential.tape, points, bits=first)
    if not found.defined:
        points = defined_points(body, potential.tape, PRECISIONS, is_late)
        found = survey(body, potential.tape, points, bits=first)
    # All points at the ends of the ladder, a few on the way.
    stages = [*((bits, points[:LADDER_POINTS]) for bits in middle), (last, points)]
    for bits, chosen in stages:
        if found.counterexample is not None:
            return _refuted(found.counterexample)
        further = survey(body, potential.tape, chosen, bits=bits, is_late=is_late)
        if is_late() and further.counterexample is None:
            break
        found = further
    if found.counterexample is not None:
        return _refuted(found.counterexample)
    largest = f"{found.largest.mid} ± {found.largest.rad}"
    evidence = NumericEvidence(len(found.defined), found.bits, largest, doubt)
    return Verdict("undecided", "numeric", evidence=evidence)


def _decide_general(
    body: RigidBody, potential: GeneralPotential, points: Sequence[Point], is_late: Callable[[], bool]
) -> Verdict:
    """Confirm H = −F(w), which is proved for all F and G in :mod:`.energy_terms`, by the values of V.

    F is a function of the curve, whose kinks no curve crosses; those of G are circles of g2, where V must
    be continuous.
    """
    defects = (energy_defect(body, potential, point) for point in chain(points, fine_sphere_points()))
    defined: list[arb] = []
    for defect in defects:
        if defect.is_finite():
            defined.append(defect)
        if len(defined) == ENERGY_POINTS or is_late():
            break
    if not defined and is_late():
        evidence = NumericEvidence(0, PRECISIONS[0], "0 ± 0", "that the potential has a value anywhere")
        return Verdict("undecided", "numeric", evidence=evidence)
    if not defined:
        raise UndefinedPotentialError(
            "the potential has no finite value at any of the points tried all over the unit sphere",
            pointer="/potential",
        )
    if not all(defect.contains(0) for defect in defined):
        return _refute_general(body, potential, points)
    for tape in dict.fromkeys(piece.even.tape for piece in potential.pieces):
        jump, doubt = lines_of(body, tape, is_late)
        if jump is not None:
            return Verdict("inadmissible", "counterexample", jump=jump)
        if doubt is not None:
            evidence = NumericEvidence(len(defined), PRECISIONS[0], "0 ± 0", doubt)
            return Verdict("undecided", "numeric", evidence=evidence)
    formulas = energy_formulas(body, potential)
    if formulas is None:
        return Verdict("admissible", "symbolic")
    if len(set(formulas.values())) > 1:
        return Verdict("admissible", "symbolic", energy_formulas=formulas)
    return Verdict("admissible", "symbolic", energy_formula=formulas["pp"])


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
    doubt = "that the energy is the function of the curve that F says"
    evidence = NumericEvidence(count, PRECISIONS[0], f"{found.mid} ± {found.rad}", doubt)
    return Verdict("undecided", "numeric", evidence=evidence)


def _refuted(counterexample: Counterexample) -> Verdict:
    return Verdict("inadmissible", "counterexample", counterexample=counterexample)
