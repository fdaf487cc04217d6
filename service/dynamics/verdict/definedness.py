"""Checks that a potential, and every part of its formula, has a value somewhere on the sphere."""

from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import ClassVar

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.refutations.counterexample import survey
from service.dynamics.verdict.sphere.pieces import TooManyPiecesError, find_pieces
from service.dynamics.verdict.sphere.points import Point, fine_sphere_points, sphere_points
from service.dynamics.verdict.sphere.switches import find_switches

PRECISIONS = (128, 4096)
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
    defined_points(body, whole, PRECISIONS, is_late)


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
