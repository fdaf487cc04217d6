"""Proves or refutes a formula with absolute values piece by piece, and across the lines between."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from service.dynamics.body import RigidBody
from service.dynamics.formula.tape import Tape
from service.dynamics.verdict.proofs.energy_terms import EnergyTerms, OctantTerms, energy_terms
from service.dynamics.verdict.proofs.on_lines import (
    has_no_value,
    is_circle,
    is_continuous_with,
    is_not_crossed,
    joins,
)
from service.dynamics.verdict.proofs.proof import Proof, Signs, prove
from service.dynamics.verdict.refutations.counterexample import Counterexample, survey
from service.dynamics.verdict.refutations.jumps import Jump, find_jump
from service.dynamics.verdict.sphere.pieces import Crossing, SpherePieces, TooManyPiecesError, find_pieces
from service.dynamics.verdict.sphere.points import Point
from service.dynamics.verdict.sphere.switches import Switches, find_switches

PIECE_PRECISIONS = (128, 1024)
"""Precisions of the enclosures at the points of every piece, in turn."""


@dataclass(frozen=True, slots=True)
class PiecewiseFindings:
    """The result for the pieces.

    ``doubt`` is a sentence on what is not proved, None if all is. ``points`` are points of all pieces.
    """

    counterexample: Counterexample | None = None
    jump: Jump | None = None
    doubt: str | None = None
    terms: OctantTerms | None = None
    points: Sequence[Point] = ()

    @property
    def is_refuted(self) -> bool:
        """Whether something certainly contradicts."""
        return self.counterexample is not None or self.jump is not None


def examine_pieces(
    body: RigidBody, tape: Tape, is_proved: bool, is_late: Callable[[], bool]
) -> PiecewiseFindings | None:
    """Return what is found on the pieces of a formula, None if there is one piece, with no lines in it.

    With ``is_proved`` there is a proof that L(V) = 0 on all pieces at once.
    """
    switches = find_switches(tape)
    if not switches.absolutes:
        return None
    try:
        pieces = find_pieces(switches, is_late)
    except TooManyPiecesError as error:
        return PiecewiseFindings(doubt=f"on which pieces V is analytic: {error}")
    points = [point for known in pieces.points.values() for point in known]
    counterexample = _refuting(body, tape, points, is_late)
    if counterexample is not None:
        return PiecewiseFindings(counterexample=counterexample, points=points)
    proofs: list[Proof] = []
    if not is_proved:
        for signs in pieces.all:
            proof = None if is_late() else prove(body, switches.on_piece(signs))
            if proof is None:
                doubt = f"that the compatibility equation holds on each of the {len(pieces.all)} pieces of V"
                return PiecewiseFindings(doubt=doubt, points=points)
            proofs.append(proof)
    jump, unproved = examine_lines(body, switches, pieces, is_late)
    terms = None if is_proved else _common_terms(body, proofs)
    return PiecewiseFindings(jump=jump, doubt=unproved, terms=terms, points=points)


def lines_of(body: RigidBody, tape: Tape, is_late: Callable[[], bool]) -> tuple[Jump | None, str | None]:
    """Return what :func:`examine_lines` does, of a formula that is admissible on every piece."""
    switches = find_switches(tape)
    if not switches.absolutes:
        return None, None
    try:
        pieces = find_pieces(switches, is_late)
    except TooManyPiecesError as error:
        return None, f"on which pieces V is analytic: {error}"
    return examine_lines(body, switches, pieces, is_late)


def examine_lines(
    body: RigidBody, switches: Switches, pieces: SpherePieces, is_late: Callable[[], bool]
) -> tuple[Jump | None, str | None]:
    """Return a jump across one of the lines between the pieces, else what is not proved of them."""
    harmless: dict[int, bool] = {}
    doubt: str | None = None
    for crossing in pieces.lines:
        if is_late():
            return None, doubt or "that V and its energy are the same on both sides of all kinks"
        switch = crossing.switch
        if switch not in harmless:
            harmless[switch] = is_harmless(body, switches, switch)
        if harmless[switch] or is_joined(body, switches, crossing) or is_edge(switches, crossing):
            continue
        for box in pieces.lines[crossing]:
            jump = find_jump(body, switches, switch, (crossing.positive, crossing.negative), box)
            if jump is not None:
                return jump, None
            if is_late():
                break
        doubt = (
            "that V and its energy are the same on both sides of a line where an absolute value has a kink"
        )
    return None, doubt


def is_harmless(body: RigidBody, switches: Switches, switch: int) -> bool:
    """Whether no curve crosses the line, or it is a circle of g2 with V continuous on it."""
    argument = switches.argument(switch)
    if is_circle(body, argument) and is_continuous_with(body, switches, switch):
        return True
    return is_not_crossed(body, argument)


def is_joined(body: RigidBody, switches: Switches, crossing: Crossing) -> bool:
    """Whether V and H are proved the same on both sides of the line between two pieces."""
    above, below = switches.on_piece(crossing.positive), switches.on_piece(crossing.negative)
    return joins(body, above, below, switches.argument(crossing.switch))


def is_edge(switches: Switches, crossing: Crossing) -> bool:
    """Whether the formula is proved to have no value on one side of the line between two pieces."""
    argument = switches.argument(crossing.switch)
    sides = ((crossing.positive, 1), (crossing.negative, -1))
    return any(has_no_value(switches.on_piece(signs), argument, sign) for signs, sign in sides)


def _refuting(
    body: RigidBody, tape: Tape, points: Sequence[Point], is_late: Callable[[], bool]
) -> Counterexample | None:
    for bits in PIECE_PRECISIONS:
        if is_late():
            return None
        found = survey(body, tape, points, bits=bits).counterexample
        if found is not None:
            return found
    return None


def _common_terms(body: RigidBody, proofs: Sequence[Proof]) -> OctantTerms:
    """Return the terms of the energy in every octant, None where two pieces differ in them."""
    found: dict[Signs, EnergyTerms | None] = {}
    for proof in proofs:
        for signs, terms in energy_terms(body, proof).items():
            found[signs] = terms if found.setdefault(signs, terms) == terms else None
    return found
