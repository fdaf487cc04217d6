"""Writes the registers of a formula's program as exact polynomials in g1, g2, g3."""

from collections.abc import Callable

from flint import Ordering, fmpq, fmpq_mpoly, fmpq_mpoly_ctx, fmpq_poly

from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.formula.tape import Instruction, Recorder

_G2 = 1

MAX_DEGREE = 16
MAX_TERMS = 150
"""Largest number of terms of a polynomial: what is done with one takes some milliseconds."""
MAX_BITS = 4096
"""Largest size of a coefficient, in bits."""


class RegisterPolynomials:
    """The registers of a recorder as polynomials, as far as they are small ones.

    Parameters
    ----------
    order
        The positions of g1, g2, g3 among the polynomials' variables: on the sphere the square of the first
        one is replaced.
    """

    def __init__(self, recorder: Recorder, order: tuple[int, int, int]) -> None:
        self._recorder = recorder
        self._order = order
        self.context = fmpq_mpoly_ctx.get([f"g{place + 1}" for place in order], Ordering.lex)
        self._known: dict[int, fmpq_mpoly | None] = {}

    def of(self, register: int) -> fmpq_mpoly | None:
        """Return the polynomial that a register is as it stands, None if it is no small one."""
        for each in range(register + 1):
            if each not in self._known:
                found = self._made(each)
                self._known[each] = found if found is not None and _is_small(found) else None
        return self._known[register]

    def on_sphere(self, polynomial: fmpq_mpoly) -> fmpq_mpoly:
        """Return the polynomial with the same values on the sphere and the first variable once at most."""
        first, second, third = self.context.gens()
        return polynomial % (first**2 - (1 - second**2 - third**2))

    def in_g2(self, register: int) -> fmpq_poly | None:
        """Return the polynomial in g2 that a register is on the sphere, None if it is none.

        The square that is replaced is not that of g2.
        """
        found = self.of(register)
        if found is None:
            return None
        place, coefficients = self._order.index(_G2), dict[int, fmpq]()
        for exponents, value in self.on_sphere(found).terms():
            if any(power for k, power in enumerate(exponents) if k != place):
                return None
            coefficients[int(exponents[place])] = value
        return fmpq_poly([coefficients.get(k, fmpq(0)) for k in range(max(coefficients, default=0) + 1)])

    def _made(self, register: int) -> fmpq_mpoly | None:
        made = self._recorder.instruction(register)
        if made is None:
            return self.context.gens()[self._order.index(register)] if register in self._order else None
        if made.operation == "constant" and made.number is not None:
            return self.context.constant(fmpq(made.number.numerator, made.number.denominator))
        left = self._known.get(made.left) if made.left >= 0 else None
        right = self._known.get(made.right) if made.right >= 0 else None
        if left is None:
            return None
        if made.operation == "negate":
            return -left
        if made.operation == "power" and made.number is not None:
            degree = int(left.total_degree())
            fits = made.number.denominator == 1 and 0 < made.number <= MAX_DEGREE // max(degree, 1)
            return left ** int(made.number) if fits and len(left) <= 10 else None
        operation = _OPERATIONS.get(made.operation)
        if right is None or operation is None:
            return None
        if made.operation == "divide" and (not right.is_constant() or not right):
            return None
        return operation(left, right)


_OPERATIONS: dict[str, Callable[[fmpq_mpoly, fmpq_mpoly], fmpq_mpoly]] = {
    "add": lambda x, y: x + y,
    "subtract": lambda x, y: x - y,
    "multiply": lambda x, y: x * y,
    "divide": lambda x, y: x / y.leading_coefficient(),
}


def written_in_g2(recorder: Recorder, polynomial: fmpq_poly) -> int:
    """Return the register of a polynomial in g2, by Horner's rule."""
    *lower, lead = map(as_fraction, polynomial.coeffs() or [fmpq(0)])
    total = recorder.emit(Instruction("constant", number=lead))
    for value in reversed(lower):
        total = recorder.emit(Instruction("multiply", total, _G2))
        if value:
            constant = recorder.emit(Instruction("constant", number=value))
            total = recorder.emit(Instruction("add", total, constant))
    return total


def _is_small(polynomial: fmpq_mpoly) -> bool:
    if len(polynomial) > MAX_TERMS or (len(polynomial) and int(polynomial.total_degree()) > MAX_DEGREE):
        return False
    return all(int(coefficient.height_bits()) <= MAX_BITS for coefficient in polynomial.coeffs())
