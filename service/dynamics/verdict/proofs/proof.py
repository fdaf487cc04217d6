"""Proves L(V) = 0 by exact algebra, octant by octant, and that two formulas are the same function.

The latter is never guessed from values. The ring of :mod:`..exact_ring` has three coordinates on the unit
sphere. Formulas in g1, g2, g3 are compared on the sphere, where potentials live; a formula in one or two
other real variables x, y is compared with x = g1/g3 and y = g2/g3, which take all real values. Further names,
those of parameters, are compared coefficient by coefficient.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Literal

from flint import ctx

from service.dynamics.body import RigidBody
from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebra import Algebra, T
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parameters import PI, coefficients_of
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.formula.tree import VARIABLES, Number, Symbol, Tree, post_order
from service.dynamics.verdict.exact_ring.generators import (
    Element,
    Layout,
    NoProofError,
    UndefinedInOctantError,
    Work,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.ring_functions.ring_algebra import (
    RingAlgebra,
    VectorFields,
    in_large_enough_ring,
)

Signs = tuple[int, int, int]
Assumption = tuple[Tape, Literal[1, -1]]
"""A formula in g1, g2, g3 with the sign that it has."""


@dataclass(frozen=True, slots=True)
class EnergyInOctant:
    """H as an element of the ring of its octant."""

    signs: Signs
    ring: Ring
    H: Element


@dataclass(frozen=True, slots=True)
class Proof:
    """L(V) = 0 wherever V is defined and smooth.

    ``octants`` holds H for each octant where the formula can have a value; one
    entry stands for all octants if ``sign_dependent`` (positions 0, 1, 2 of
    g1, g2, g3) is empty.
    """

    sign_dependent: frozenset[int]
    octants: tuple[EnergyInOctant, ...]


def prove(body: RigidBody, tape: Tape, assumptions: Sequence[Assumption] = ()) -> Proof | None:
    """Return the proof that L(V) = 0 on the sphere, or None if there is none this way.

    With ``assumptions``, on the part of the sphere where they all hold.

    None means refuted *or* not decided: atoms may hide a relation, or the
    polynomials are too large. The proof is about points where V has a value;
    the caller checks that there are any.
    """
    octants: list[EnergyInOctant] = []
    sign_dependent: set[int] = set()
    pending: list[Signs] = [(1, 1, 1)]
    done: set[Signs] = set()
    layout, work = Layout(), Work()
    while pending:
        signs = pending.pop()
        done.add(signs)
        try:
            ring, (H, vanishes) = _examine(body, tape, assumptions, layout, work, signs, sign_dependent)
        except UndefinedInOctantError:
            pass
        except NoProofError:
            return None
        else:
            layout = ring.layout
            if not vanishes:
                return None
            octants.append(EnergyInOctant(signs, ring, H))
        pending = [octant for octant in octants_of(sign_dependent) if octant not in done]
    return Proof(frozenset(sign_dependent), tuple(octants)) if octants else None


def _examine(
    body: RigidBody,
    tape: Tape,
    assumptions: Sequence[Assumption],
    layout: Layout,
    work: Work,
    signs: Signs,
    sign_dependent: set[int],
) -> tuple[Ring, tuple[Element, bool]]:
    """Return the ring that was large enough, H, and whether ΞH = 0; note the signs that mattered."""

    def compute(ring: Ring, algebra: RingAlgebra) -> tuple[Element, bool]:
        try:
            fields = VectorFields(body, algebra, ring)
            coordinates = [ring.coordinate(position) for position in range(3)]
            for assumed, sign in assumptions:
                algebra.assume(assumed.evaluate(algebra, coordinates), sign)
            V = tape.evaluate(algebra, coordinates)
            H = fields.H(V)
            return H, ring.normal(fields.derivative("along", H)).is_zero
        finally:
            sign_dependent.update(ring.sign_dependent)

    return in_large_enough_ring(layout, signs, compute, work)


def octants_of(sign_dependent: Iterable[int]) -> list[Signs]:
    """Return the octants that differ in the signs of these coordinates."""
    octants: list[Signs] = [(1, 1, 1)]
    for position in sorted(sign_dependent):
        flipped = [(*s[:position], -1, *s[position + 1 :]) for s in octants]
        octants += [(s[0], s[1], s[2]) for s in flipped]
    return octants


MAX_FREE_VARIABLES = 2
"""Variables other than g1, g2, g3 that the sphere has room for."""
_CHECK_BITS = 192
_PLACES = tuple(
    (Fraction(a), Fraction(b), Fraction(c))
    for a, b, c in (
        ("3/7", "5/9", "2/3"),
        ("1/9", "7/8", "4/11"),
        ("8/9", "2/13", "1/5"),
        ("5/4", "3/8", "7/5"),
        ("13/6", "17/3", "9/2"),
        ("1/20", "1/30", "11/10"),
    )
)
"""Where values are compared beside the proof, with all signs that the variables may have."""
_ZERO = Number(Fraction(0))


def is_same_function(left: Tree, right: Tree, signs: Mapping[str, int]) -> bool:
    """Whether ``right`` has a value wherever ``left`` has one, and the same: proved.

    That it has the same value is proved in the ring, that it has one is tested at some places too. False is
    no claim.

    Parameters
    ----------
    signs
        Of every variable: +1 or -1 if it has one, 0 if it may have any. Names without an entry are
        parameters.
    """
    names = {node.name for tree in (left, right) for node in post_order(tree) if isinstance(node, Symbol)}
    variables = sorted(names & set(signs))
    parameters = sorted(names - set(signs) - {PI})
    if not set(variables) <= set(VARIABLES) and len(variables) > MAX_FREE_VARIABLES:
        return False
    try:
        whole = [compile_tape(tree, (*variables, *parameters)) for tree in (left, right)]
        return _meets(
            whole[0], whole[1], [*(signs[name] for name in variables), *(0 for _ in parameters)]
        ) and (_is_proved(left, right, variables, parameters, signs))
    except FormulaError:
        return False


def _is_proved(
    left: Tree, right: Tree, variables: Sequence[str], parameters: Sequence[str], signs: Mapping[str, int]
) -> bool:
    first, second = coefficients_of(left, parameters), coefficients_of(right, parameters)
    if first is None or second is None:
        return False
    work = Work()
    for powers in first.keys() | second.keys():
        tapes = [compile_tape(part.get(powers, _ZERO), tuple(variables)) for part in (first, second)]
        if not _same_everywhere(tapes[0], tapes[1], [signs[name] for name in variables], work):
            return False
    return True


def same_on_sphere(left: Tape, right: Tape, work: Work) -> bool:
    """Whether formulas in g1, g2, g3 are equal wherever the left one has a value on the sphere: proved."""
    return _same_everywhere(left, right, [0] * len(left.variables), work)


def _same_everywhere(left: Tape, right: Tape, signs: Sequence[int], work: Work) -> bool:
    """Whether the tapes are equal for all signs of their variables; True also where both are undefined."""
    if left == right:
        return True
    is_on_sphere = set(left.variables) <= set(VARIABLES)
    axes = [VARIABLES.index(name) if is_on_sphere else axis for axis, name in enumerate(left.variables)]

    def is_same_in(ring: Ring, algebra: RingAlgebra) -> bool:
        places = [ring.coordinate(axis) for axis in axes]
        if not is_on_sphere:
            places = [algebra.divide(place, ring.coordinate(2)) for place in places]
        try:
            value = left.evaluate(algebra, places)
        except UndefinedInOctantError:
            return True
        try:
            other = right.evaluate(algebra, places)
        except UndefinedInOctantError:
            return False
        return ring.normal(algebra.subtract(value, other)).is_zero

    layout = Layout()
    for chosen in product(*((sign,) if sign else (1, -1) for sign in signs)):
        sign_of = dict(zip(axes, chosen, strict=True))
        octant = (sign_of.get(0, 1), sign_of.get(1, 1), sign_of.get(2, 1))
        try:
            ring, is_same = in_large_enough_ring(layout, octant, is_same_in, work)
        except NoProofError:
            return False
        if not is_same:
            return False
        layout = ring.layout
    return True


def _meets(left: Tape, right: Tape, signs: Sequence[int]) -> bool:
    """Whether the right balls meet the left ones wherever these are finite, which they are somewhere."""
    balls, found = BallAlgebra(), 0
    with ctx.workprec(_CHECK_BITS):
        for place in _places(balls, signs):
            value, other = left.evaluate(balls, place), right.evaluate(balls, place)
            if value.is_finite():
                found += 1
                if not (other.is_finite() and other.overlaps(value)):
                    return False
    return found > 0


def _places(balls: Algebra[T], signs: Sequence[int]) -> Iterator[list[T]]:
    """Yield values of the variables, in turn with every sign that the first few of them may have."""
    free = [index for index, sign in enumerate(signs) if not sign][:3]
    for place in _PLACES:
        for chosen in product((1, -1), repeat=len(free)):
            turned = dict(zip(free, chosen, strict=True))
            yield [
                # Parameters are not all the same number, lest what cancels for equal ones be overlooked.
                balls.constant(
                    place[index % 3] * (1 + Fraction(index // 3, 7)) * (sign or turned.get(index, 1))
                )
                for index, sign in enumerate(signs)
            ]
