"""Rewrites a formula to an equal one on the sphere that gives tighter interval bounds, also near a pole.

Two rewritings are for parts that depend on g2 alone there: a polynomial that does, such as g1² + g3² − c, is
written in g2 where a function, a root or a quotient is taken of it, so that it does not change at all around
the second axis; and |x| + x is written x (1 + sign x), which is 0 where x < 0 and not the width of x.

Next to g2 = σ = ±1 a formula may hold 1 − g2², (1 + g2)² or 1 − g2² − g3², which bounds of g2 know to be
small, and no more. With u = 1 − σ g2 the polynomials in g2 are polynomials in u, which is known to all
digits as (g1² + g3²) / (1 + |g2|): (1 + g2)² is u² for σ = −1. And on the sphere
u² = 2u − g1² − g3², so that every polynomial in g1, g2, g3 is one, and only one, without u²:
1 − g2² − g3² is g1².
"""

from collections.abc import Callable
from fractions import Fraction
from typing import Literal

from service.dynamics.formula.algebra import DerivedOperations
from service.dynamics.formula.algebras.monomials import (
    ONE,
    MonomialAlgebra,
    MonomialSum,
    NotAMonomialSumError,
    Rules,
    SquareRelation,
    as_fraction,
)
from service.dynamics.formula.rewriting import RegisterPolynomials, written_in_g2
from service.dynamics.formula.tape import Instruction, Recorder, Tape

_G2 = 1
_ORDER = (2, 0, _G2)
"""g3² is replaced on the sphere: a polynomial in g2 stays one."""


def tight_form(tape: Tape) -> Tape:
    """Return the tape rewritten; its variables begin with g1, g2, g3."""
    found: Tape | None = tape.derived.get(tight_form)
    if found is None:
        found = tape.derived[tight_form] = _rewritten(tape)
    return found


def _rewritten(tape: Tape) -> Tape:
    writer = _Writer(tape.variables)
    at = list(range(len(tape.variables)))
    for instruction in tape.instructions:
        at.append(writer.write(instruction, at))
    return writer.whole(at[tape.result])


class _Writer(Recorder):
    def __init__(self, variables: tuple[str, ...]) -> None:
        super().__init__(variables)
        self._polynomials = RegisterPolynomials(self, _ORDER)
        self._turns = {k: k != _G2 for k in range(len(variables))}
        """Whether a register is written with g1 or g3, or with anything but g2."""

    def emit(self, instruction: Instruction) -> int:
        """Return the register of an instruction, which is appended unless it is there."""
        register = super().emit(instruction)
        self._turns[register] = any(self._turns[k] for k in _operands(instruction))
        return register

    def write(self, instruction: Instruction, at: list[int]) -> int:
        """Write one instruction of the old tape, whose registers are now those of ``at``."""
        operation, _, _, number, _ = instruction
        left, right = (at[k] if k >= 0 else k for k in (instruction.left, instruction.right))
        is_whole = number is not None and number.denominator == 1 and number > 0
        is_power = operation == "power" and not is_whole
        if operation in ("call", "general_power") or is_power:
            left = self._in_g2(left)
        if operation in ("divide", "general_power"):
            right = self._in_g2(right)
        found = self._without_width(operation, left, right)
        return self.emit(instruction._replace(left=left, right=right)) if found is None else found

    def _without_width(self, operation: str, left: int, right: int) -> int | None:
        """Return the register of |x| ± x or x − |x|, None if it is something else."""
        if operation not in ("add", "subtract"):
            return None
        for size, x in ((left, right), (right, left)):
            if not self._is_size_of(size, x) or self._turns[x]:
                continue
            sign = self.emit(Instruction("call", x, name="sign"))
            one = self._constant(Fraction(1))
            ends = (one, sign) if operation == "add" or size == right else (sign, one)
            factor = self.emit(Instruction("add" if operation == "add" else "subtract", *ends))
            return self.emit(Instruction("multiply", x, factor))
        return None

    def _is_size_of(self, register: int, x: int) -> bool:
        made = self.instruction(register)
        # What |x| was taken of may have been written in g2.
        return made is not None and made.name == "abs" and made.left in (x, self._in_g2(x))

    def _in_g2(self, register: int) -> int:
        """Return the register of a polynomial in g2 alone if this is one, else this."""
        polynomial = self._polynomials.in_g2(register) if self._turns[register] else None
        if polynomial is None:
            return register
        made = self.instruction(register)
        if made is not None:
            parts = {k: self._in_g2(k) for k in _operands(made)}
            if parts and not any(self._turns[k] for k in parts.values()):
                # As it is written: multiplied out, a square loses its sign and a root its place.
                left, right = (parts.get(k, k) for k in (made.left, made.right))
                return self.emit(made._replace(left=left, right=right))
        return written_in_g2(self, polynomial)

    def _constant(self, value: Fraction) -> int:
        return self.emit(Instruction("constant", number=value))


def _operands(instruction: Instruction) -> list[int]:
    return [k for k in (instruction.left, instruction.right) if k >= 0]


MOST_TERMS = 24
HIGHEST_DEGREE = 24
Element = MonomialSum | int
"""A polynomial in g1, u and g3, or the number of a register."""
VARIABLES = ("g1", "g2", "g3", "u")
_PLACES = (0, 3, 2)
"""Variables of the three exponents of a monomial."""
_SQUARE_OF_U = SquareRelation(1, ((0, 1, 0, 2), (2, 0, 0, -1), (0, 0, 2, -1)))


def pole_forms(tape: Tape, sigma: int) -> tuple[Tape, Tape]:
    """Return tapes over g1, g2, g3 and u with the same values on the sphere, neither with g2.

    The first has powers of u, the second none but the first.
    """
    return _pole_form(tape, sigma, None), _pole_form(tape, sigma, _SQUARE_OF_U)


def _pole_form(tape: Tape, sigma: int, relation: SquareRelation | None) -> Tape:
    writer = _PoleWriter(relation)
    result = writer.register(tape.evaluate(writer, writer.coordinates(sigma)))
    return writer.recorder.whole(result)


class _PoleWriter(DerivedOperations[Element]):
    """An algebra that writes instructions for all that is no polynomial."""

    def __init__(self, relation: SquareRelation | None) -> None:
        self.recorder = Recorder(VARIABLES)
        self._polynomials = MonomialAlgebra(
            Rules(
                (1, 1, 1),
                relation=relation,
                most_terms=MOST_TERMS,
                most_products=MOST_TERMS**2,
                most_degree=HIGHEST_DEGREE,
            )
        )

    def coordinates(self, sigma: int) -> list[Element]:
        """Return g1, g2 = σ (1 - u) and g3."""
        g1, u, g3 = self._polynomials.coordinates()
        one = self._polynomials.constant(Fraction(sigma))
        return [g1, self._polynomials.add(one, {key: -sigma * value for key, value in u.items()}), g3]

    def constant(self, value: Fraction) -> Element:
        return self._polynomials.constant(value)

    def pi(self) -> Element:
        return self._emit(Instruction("pi"))

    def add(self, left: Element, right: Element) -> Element:
        return self._combined("add", self._polynomials.add, left, right)

    def negate(self, operand: Element) -> Element:
        if isinstance(operand, dict):
            return self._polynomials.negate(operand)
        return self._emit(Instruction("negate", operand))

    def multiply(self, left: Element, right: Element) -> Element:
        return self._combined("multiply", self._polynomials.multiply, left, right)

    def divide(self, left: Element, right: Element) -> Element:
        if isinstance(right, dict) and set(right) == {ONE}:
            return self.multiply(left, {ONE: 1 / right[ONE]})
        return self._emit(Instruction("divide", self.register(left), self.register(right)))

    def power(self, base: Element, exponent: Fraction) -> Element:
        if isinstance(base, dict) and exponent.denominator == 1 and 0 < exponent <= HIGHEST_DEGREE:
            try:
                return self._polynomials.power(base, exponent)
            except NotAMonomialSumError:
                pass
        return self._emit(Instruction("power", self.register(base), number=exponent))

    def general_power(self, base: Element, exponent: Element) -> Element:
        return self._emit(Instruction("general_power", self.register(base), self.register(exponent)))

    def call(self, name: str, argument: Element) -> Element:
        return self._emit(Instruction("call", self.register(argument), name=name))

    def register(self, element: Element) -> int:
        """Return the register of an element, a polynomial being written as the sum of its terms."""
        if isinstance(element, int):
            return element
        ordered = sorted(element.items(), key=lambda term: (term[0][0], term[0][2], term[0][1]))
        terms = [self._term(monomial[:3], as_fraction(value)) for monomial, value in ordered]
        if not terms:
            return self._emit(Instruction("constant", number=Fraction(0)))
        total, *rest = terms
        for term in rest:
            total = self._emit(Instruction("add", total, term))
        return total

    def _term(self, exponents: tuple[int, int, int], value: Fraction) -> int:
        powers = {place: power for place, power in zip(_PLACES, exponents, strict=True) if power}
        factors = [
            place if power == 1 else self._emit(Instruction("power", place, number=Fraction(power)))
            for place, power in sorted(powers.items())
        ]
        if value != 1 or not factors:
            factors.insert(0, self._emit(Instruction("constant", number=value)))
        product, *rest = factors
        for factor in rest:
            product = self._emit(Instruction("multiply", product, factor))
        return product

    def _combined(
        self,
        operation: Literal["add", "multiply"],
        combine: Callable[[MonomialSum, MonomialSum], MonomialSum],
        left: Element,
        right: Element,
    ) -> Element:
        if isinstance(left, dict) and isinstance(right, dict):
            try:
                return combine(left, right)
            except NotAMonomialSumError:
                pass
        return self._emit(Instruction(operation, self.register(left), self.register(right)))

    def _emit(self, instruction: Instruction) -> int:
        return self.recorder.emit(instruction)
