r"""Proves continuity exactly where a curve crosses the line x = 0 of an absolute value \|x\|.

On both sides V is analytic, V₊ with \|x\| = x and V₋ with \|x\| = -x, and L(V) = 0 makes H constant on
every stretch of a curve. A motion goes on through the line with q = 0 if V and H are the same on both
sides of it. The line does no harm if

* x is constant on the curves where it is 0: no curve crosses it; or
* V₊ - V₋ and H₊ - H₋ are multiples of x in the ring; or
* x depends on g2 only, and V is continuous. For H = V + Q D/(2 (A - C) g1 g3) has the derivative D along
  the circles g2 = const as its only one, and continuous values on a circle have one derivative along it.

An element is a multiple of x if x divides it, after both were multiplied by the conjugates of x with
respect to g2 and to square roots: these make x a polynomial without relations, and division decisive.

Whether a formula is continuous where an absolute value is 0 is decided from its operations.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import product

from flint import arb, fmpq_mpoly

from service.dynamics.body import RigidBody
from service.dynamics.formula.tape import Instruction, Tape
from service.dynamics.verdict.exact_ring.generators import (
    CircleConstant,
    Coordinate,
    Cosine,
    Divisor,
    Element,
    Exponential,
    Layout,
    Nature,
    NoProofError,
    Root,
    UndefinedInOctantError,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.exact_ring.signs import GeneratorValues
from service.dynamics.verdict.ring_functions.ring_algebra import (
    RingAlgebra,
    VectorFields,
    in_large_enough_ring,
)
from service.dynamics.verdict.sphere.switches import Switches, needs_positive


def flows_continuously(tape: Tape, target: int) -> bool:
    """Whether what is done with the absolute value of a register is continuous at 0, or infinite."""
    # What depends on |x| continuously, and what has log |x| in it.
    smooth: set[int] = set()
    logarithmic: set[int] = set()
    for register, made in enumerate(tape.instructions, start=len(tape.variables)):
        if made.operation == "call" and made.name == "abs" and made.left == target:
            smooth.add(register)
            continue
        operands = {made.left, made.right}
        if operands & logarithmic:
            divides = made.operation == "divide" and made.right in smooth | logarithmic
            if divides or not _is_polynomial(made):
                return False
            logarithmic.add(register)
        elif operands & smooth:
            is_log = made.operation == "call" and made.name == "log"
            if is_log and _is_absolute_of(tape, made.left, target):
                logarithmic.add(register)
            elif _is_regular(made, smooth):
                smooth.add(register)
            else:
                return False
    return True


def _is_absolute_of(tape: Tape, register: int, target: int) -> bool:
    made = tape.instructions[register - len(tape.variables)]
    return made.operation == "call" and made.name == "abs" and made.left == target


def _is_polynomial(made: Instruction) -> bool:
    if made.operation == "power":
        return made.number is not None and made.number.denominator == 1 and made.number > 0
    return made.operation in ("add", "subtract", "multiply", "divide", "negate")


def _is_regular(made: Instruction, smooth: set[int]) -> bool:
    """Whether an instruction is continuous at 0 in what depends on the absolute value."""
    if made.operation == "divide":
        return made.right not in smooth
    if made.operation == "power":
        return made.number is not None and made.number > 0
    if needs_positive(made):
        return False
    return made.operation != "call" or made.name in ("exp", "sin", "cos", "abs")


MAX_CONJUGATES = 8

_OCTANTS = [(a, b, c) for a, b, c in product((1, -1), repeat=3)]

Claim = Callable[[Ring, RingAlgebra, VectorFields], bool]


def is_not_crossed(body: RigidBody, argument: Tape) -> bool:
    """Whether the derivative of x along the curves is proved to vanish where x = 0."""

    def vanishes(ring: Ring, algebra: RingAlgebra, fields: VectorFields) -> bool:
        x = _value(argument, ring, algebra)
        # The field is g2 X, and all curves cross the equator.
        g2 = ring.monomial({ring.coordinate_index[1]: -ring.layout.degree("g2")})
        return is_multiple(ring, ring.multiply(fields.derivative("along", x), g2), x)

    return _in_all_octants(body, vanishes)


def joins(body: RigidBody, above: Tape, below: Tape, argument: Tape) -> bool:
    """Whether V and H are proved the same on both sides of x = 0: ``above`` it and ``below`` it."""

    def vanishes(ring: Ring, algebra: RingAlgebra, fields: VectorFields) -> bool:
        x = _value(argument, ring, algebra)
        V = algebra.subtract(_value(above, ring, algebra), _value(below, ring, algebra))
        return is_multiple(ring, V, x) and is_multiple(ring, fields.H(V), x)

    return _in_all_octants(body, vanishes)


def jumps_at(
    body: RigidBody, above: Tape, below: Tape, octant: tuple[int, int, int], g: tuple[arb, arb, arb]
) -> tuple[arb, arb]:
    """Return enclosures of V₊ - V₋ and H₊ - H₋ at a place, where they may be 0/0 as they are written."""
    found: list[arb] = []

    def evaluate(ring: Ring, algebra: RingAlgebra, fields: VectorFields) -> bool:
        V = algebra.subtract(_value(above, ring, algebra), _value(below, ring, algebra))
        values = GeneratorValues(ring, g)
        found[:] = [values.element(fields.cancelled(V)), values.element(fields.H(V))]
        return True

    if _in_octants(body, evaluate, [octant]) and found:
        return found[0], found[1]
    return arb("nan"), arb("nan")


def has_no_value(tape: Tape, argument: Tape, sign: int) -> bool:
    """Whether a formula is proved to have no value wherever another one has the sign."""

    def has_some(ring: Ring, algebra: RingAlgebra) -> bool:
        algebra.assume(_value(argument, ring, algebra), sign)
        return not _value(tape, ring, algebra).is_zero

    for octant in _OCTANTS:
        try:
            in_large_enough_ring(Layout(), octant, has_some)
        except UndefinedInOctantError:
            continue
        except NoProofError:
            return False
        return False
    return True


def is_multiple(ring: Ring, element: Element, x: Element) -> bool:
    """Whether ``element`` is proved to vanish where x = 0."""
    element, x = _without_units(ring, element), _without_units(ring, x)
    if element.is_zero:
        return True
    if x.is_zero or x.is_number:
        return False
    if any(_may_vanish_with(ring, index, x) for index, e in enumerate(element.shift) if e < 0):
        return False
    for index in _related(ring):
        if int(x.numerator.degrees()[index]) < 1:
            continue
        if _power(ring, index) != 2:
            return False
        # The generator occurs at most to the first power: its conjugate has the other sign there.
        conjugate = ring.polynomial(_mirrored(ring, x.numerator, index))
        element = _without_units(ring, ring.multiply(element, conjugate))
        x = _without_units(ring, ring.multiply(ring.polynomial(x.numerator), conjugate))
        if element.is_zero:
            return True
    return ring.exact_quotient(element.numerator, x.numerator) is not None


def is_circle(body: RigidBody, argument: Tape) -> bool:
    """Whether x is proved a function of g2 alone, on the sphere."""

    def vanishes(ring: Ring, algebra: RingAlgebra, fields: VectorFields) -> bool:
        return ring.normal(fields.derivative("around", _value(argument, ring, algebra))).is_zero

    return _in_all_octants(body, vanishes)


def is_continuous_with(body: RigidBody, switches: Switches, switch: int) -> bool:
    r"""Whether V goes continuously, or to infinity, through the line x = 0 of a switch.

    True if no divisor vanishes all along the line and \|x\| is only added, multiplied and put into
    functions that have a value at 0: all of these are continuous. log \|x\| may be added and multiplied: a
    polynomial in \|x\| and log \|x\| tends to infinity on both sides, or to one value.
    """
    if not flows_continuously(switches.tape, switches.absolutes[switch]):
        return False
    argument, divisors = switches.argument(switch), switches.divisors()

    def is_apart(ring: Ring, algebra: RingAlgebra, _: VectorFields) -> bool:
        x = _value(argument, ring, algebra)
        return not any(is_multiple(ring, _value(each, ring, algebra), x) for each in divisors)

    return not divisors or _in_all_octants(body, is_apart)


def _value(tape: Tape, ring: Ring, algebra: RingAlgebra) -> Element:
    return tape.evaluate(algebra, [ring.coordinate(position) for position in range(3)])


def _in_all_octants(body: RigidBody, holds: Claim) -> bool:
    return _in_octants(body, holds, _OCTANTS)


def _in_octants(body: RigidBody, holds: Claim, octants: Sequence[tuple[int, int, int]]) -> bool:
    """Whether something holds in every octant where it can be said; raised doubts are none."""

    def holds_in(ring: Ring, algebra: RingAlgebra) -> bool:
        return holds(ring, algebra, VectorFields(body, algebra, ring))

    layout, seen = Layout(), 0
    for octant in octants:
        try:
            ring, is_true = in_large_enough_ring(layout, octant, holds_in)
        except UndefinedInOctantError:
            continue
        except NoProofError:
            return False
        if not is_true:
            return False
        layout = ring.layout
        seen += 1
    return seen > 0


def _related(ring: Ring) -> Iterator[int]:
    """Yield the generators that have a relation, the greatest first, up to MAX_CONJUGATES."""
    found = [index for index in sorted(ring.natures) if _power(ring, index) > 1]
    yield from found[:MAX_CONJUGATES]


def _power(ring: Ring, index: int) -> int:
    """Return the power of a generator that is expressed by lesser ones, 0 if none is."""
    match ring.natures[index]:
        case Coordinate(1, degree):
            return 2 * degree
        case Root(_, degree):
            return degree
        case Cosine():
            return 2
    return 0


def _mirrored(ring: Ring, numerator: fmpq_mpoly, index: int) -> fmpq_mpoly:
    """Return a polynomial with a generator that occurs at most once in a term turned to its negative."""
    return numerator - 2 * ring.context.gen(index) * numerator.derivative(index)


def _without_units(ring: Ring, element: Element) -> Element:
    """Return an element in canonical form with what may be 0 in its numerator; its shift is of no zeros."""
    element = ring.canonical(element)
    kept = {
        index: exponent
        for index, exponent in enumerate(element.shift)
        if exponent > 0 and not _is_unit(ring.natures[index])
    }
    if not kept:
        return element
    numerator = element.numerator
    for index, exponent in kept.items():
        numerator = numerator * ring.context.gen(index) ** exponent
    shift = tuple(0 if index in kept else exponent for index, exponent in enumerate(element.shift))
    return ring.normal(Element(numerator, shift))


def _is_unit(nature: Nature) -> bool:
    """Whether a generator is never 0 inside an octant where the formula has a value."""
    if isinstance(nature, Coordinate):
        return nature.position != 1
    return isinstance(nature, Root | Exponential | CircleConstant)


def _may_vanish_with(ring: Ring, index: int, x: Element) -> bool:
    """Whether a generator that is divided by may be 0 all along the line x = 0."""
    nature = ring.natures[index]
    if isinstance(nature, Divisor | Root):
        base = ring.canonical(nature.base)
        return not base.is_number and is_multiple(ring, base, x)
    return not _is_unit(nature) and is_multiple(ring, ring.monomial({index: 1}), x)
