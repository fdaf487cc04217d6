"""Whether two formulas are the same function: proved in the exact ring, never guessed from values.

The ring of :mod:`..exact_ring` has three coordinates on the unit sphere. Formulas in g1, g2, g3 are
compared on the sphere, where potentials live; a formula in one or two other real variables x, y is
compared with x = g1/g3 and y = g2/g3, which take all real values. Further names, those of parameters, are
compared coefficient by coefficient.
"""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import product

from flint import ctx

from service.dynamics.formula.algebra import Algebra, T
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.errors import FormulaError
from service.dynamics.formula.parameters import PI, coefficients_of
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.formula.tree import VARIABLES, Number, Symbol, Tree, post_order
from service.dynamics.verdict.exact_ring.layout import (
    Layout,
    NoProofError,
    UndefinedInOctantError,
    Work,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.ring_functions.ring_algebra import RingAlgebra, in_large_enough_ring

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
