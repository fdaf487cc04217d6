"""Proves or refutes a formula with absolute values piece by piece of the sphere, and across the lines.

The sphere is covered with boxes; on each the sign of every switch is certain, or it may be both. Boxes are
cut as long as a combination of signs may occur in them that has not been met at a point. So every
combination that occurs is found; those that could not be excluded in the end are called possible.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

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
from service.dynamics.verdict.proofs.proof import Proof, prove
from service.dynamics.verdict.refutations import Counterexample, Jump, find_jump, survey
from service.dynamics.verdict.sphere.boxes import Boxes, Point, bounds_on, whole_sphere
from service.dynamics.verdict.sphere.switches import Signs, Switches, find_switches

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
MAX_CUT_ROUNDS = 10
"""Rounds of cutting in four: the smallest boxes have sides of a five-thousandth of a radian."""
MAX_BOXES = 30_000
"""Largest number of boxes at a time."""
MAX_SWITCHES = 10
POINTS_PER_PIECE = 6
BOXES_PER_LINE = 24
_PLACES = ((0.5, 0.5), (1e-3, 1e-3), (1e-3, 0.999), (0.999, 1e-3), (0.999, 0.999))
"""Where in a box a sign is looked at, in shares of its sides: lines may pass close to a corner."""


class TooManyPiecesError(Exception):
    """More switches, or more boxes, than are looked at."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """Two neighbouring pieces, which differ in the sign of one switch."""

    switch: int
    positive: Signs
    negative: Signs


@dataclass(slots=True)
class SpherePieces:
    """The result of the search.

    ``points``: points of every combination of signs that was met. ``possible``: combinations that could not
    be excluded. ``lines``: boxes that a crossing from one piece to the next may be in.
    """

    points: dict[Signs, list[Point]] = field(default_factory=dict)
    possible: set[Signs] = field(default_factory=set)
    lines: dict[Crossing, list[tuple[Boxes, int]]] = field(default_factory=dict)

    @property
    def all(self) -> tuple[Signs, ...]:
        """Return the combinations that occur or may occur."""
        return (*self.points, *sorted(self.possible - set(self.points), reverse=True))


def find_pieces(switches: Switches, is_late: Callable[[], bool]) -> SpherePieces:
    """Return the pieces of a formula.

    Raises
    ------
    TooManyPiecesError
        There are too many switches, or time is over.
    """
    count = len(switches.absolutes)
    if count > MAX_SWITCHES:
        raise TooManyPiecesError(f"more than {MAX_SWITCHES} absolute values")
    found, boxes = SpherePieces(), whole_sphere()
    for level in range(MAX_CUT_ROUNDS):
        if is_late():
            raise TooManyPiecesError("the time for a verdict is over")
        signs, has_value = _signs(switches, boxes)
        alive = has_value >= 0
        boxes, signs = boxes.at(alive), signs[:, alive]
        _visit(switches, boxes, found, everywhere=level == 0)
        is_open = np.zeros(len(boxes), dtype=bool)
        is_last = level == MAX_CUT_ROUNDS - 1 or 4 * len(boxes) > MAX_BOXES
        for pattern, here in _patterns(signs):
            possible = list(combinations(pattern))
            is_settled = all(each in found.points for each in possible)
            if len(possible) > 1 and (is_settled or is_last):
                _note_lines(found, pattern, boxes, here)
            if not is_settled:
                is_open[here] = True
                if is_last:
                    found.possible.update(possible)
        if is_last or not is_open.any():
            break
        boxes = boxes.at(is_open).quarters()
    return found


def _signs(switches: Switches, boxes: Boxes) -> tuple[NDArray[np.float64], IntArray]:
    """Return the signs of the absolutes, 0 where both may be; and where V has a value: 1, -1 for no, or 0."""
    registers = (*switches.absolutes, *switches.positives)
    low, high = bounds_on(boxes, switches.tape, registers)
    count = len(switches.absolutes)
    signs = np.where(low > 0.0, 1.0, np.where(high < 0.0, -1.0, 0.0))[:count]
    positive_low, positive_high = low[count:], high[count:]
    value = np.where((positive_high < 0.0).any(axis=0), -1, np.where((positive_low > 0.0).all(axis=0), 1, 0))
    return signs, value


def _visit(switches: Switches, boxes: Boxes, found: SpherePieces, *, everywhere: bool) -> None:
    """Record points where all signs are certain and do not exclude a value of V."""
    for place in _PLACES[: 1 if everywhere else None]:
        points = boxes.points(*place)
        signs, has_value = _signs(switches, points)
        certain = (has_value == 1) & (signs != 0.0).all(axis=0)
        for pattern, here in _patterns(signs[:, certain]):
            known = found.points.setdefault(pattern, [])
            where = np.flatnonzero(certain)[here]
            # Some from all over the sphere, not all from one corner.
            for index in where[:: max(1, len(where) // POINTS_PER_PIECE)]:
                if len(known) >= POINTS_PER_PIECE:
                    break
                known.append(points.middle(int(index)))


def _patterns(signs: NDArray[np.float64]) -> Iterator[tuple[Signs, IntArray]]:
    """Yield every column that occurs, and where."""
    if not signs.shape[1]:
        return
    if not signs.shape[0]:
        yield (), np.arange(signs.shape[1])
        return
    columns, inverse = np.unique(signs.astype(np.int64), axis=1, return_inverse=True)
    for number, column in enumerate(columns.T):
        yield tuple(int(sign) for sign in column), np.flatnonzero(inverse.reshape(-1) == number)


def combinations(pattern: Signs) -> Iterator[Signs]:
    """Yield the combinations of certain signs that a pattern with zeros leaves open."""
    yield from product(*((sign,) if sign else (1, -1) for sign in pattern))


def crossings_of(pattern: Signs) -> Iterator[Crossing]:
    """Yield the neighbours that a pattern with zeros leaves open."""
    for switch, sign in enumerate(pattern):
        if sign:
            continue
        for positive in combinations((*pattern[:switch], 1, *pattern[switch + 1 :])):
            yield Crossing(switch, positive, (*positive[:switch], -1, *positive[switch + 1 :]))


def _note_lines(found: SpherePieces, pattern: Signs, boxes: Boxes, here: IntArray) -> None:
    step = max(1, len(here) // BOXES_PER_LINE)
    for crossing in crossings_of(pattern):
        known = found.lines.setdefault(crossing, [])
        known += [(boxes, int(index)) for index in here[::step]][: BOXES_PER_LINE - len(known)]


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
    found: dict[tuple[int, int, int], EnergyTerms | None] = {}
    for proof in proofs:
        for signs, terms in energy_terms(body, proof).items():
            found[signs] = terms if found.setdefault(signs, terms) == terms else None
    return found
