r"""Finds where a formula is not analytic: the expressions whose signs distinguish its pieces.

A formula of the grammar is analytic but for \|x\| at x = 0, and for roots, logarithms and quotients
where the base or the divisor is 0. Even powers under roots and logarithms hide absolute values:
(x² y)^e = \|x\|^(2e) y^e and log(x² y) = 2 log \|x\| + log y. :func:`normalise` writes them so, and takes
the argument of every absolute value apart into factors. What is left under roots and
logarithms has no repeated factor that could be found.

Polynomials in g1, g2, g3 inside a formula are factored over the rationals, on the sphere.
"""

from dataclasses import dataclass
from fractions import Fraction

from flint import fmpq_mpoly

from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.formula.rewriting import RegisterPolynomials, TapeBuilder, copied, with_signs
from service.dynamics.formula.tape import Instruction, Tape

_ORDER = (1, 0, 2)


@dataclass(frozen=True, slots=True)
class Factor:
    """An irreducible factor, as a register, and its multiplicity."""

    register: int
    power: int


@dataclass(frozen=True, slots=True)
class Split:
    """constant · Π factor^power."""

    constant: Fraction
    factors: tuple[Factor, ...]


class Polynomials:
    """The registers that are small polynomials."""

    def __init__(self, builder: TapeBuilder) -> None:
        self._builder = builder
        self._polynomials = RegisterPolynomials(builder, _ORDER)
        self._registers: dict[str, tuple[int, Fraction]] = {}
        """For each irreducible factor met, by its text: a register, and the ratio of that to the factor."""

    def factors(self, register: int) -> Split | None:
        """Return the factors of a register, None if it is no small polynomial or a number.

        A polynomial is taken as it stands, and with g2² = 1 - g1² - g3² if no factor shows so.
        """
        polynomial = self._polynomials.of(register)
        if polynomial is None or polynomial.is_constant():
            return None
        reduced = self._polynomials.on_sphere(polynomial)
        if reduced.is_constant():
            return None
        constant, found = polynomial.factor()
        if len(found) == 1 and found[0][1] == 1:
            constant, found = reduced.factor()
        total, factors = as_fraction(constant), list[Factor]()
        for factor, multiplicity in found:
            leading = factor.leading_coefficient()
            monic, power = factor / leading, int(multiplicity)
            total *= as_fraction(leading) ** power
            place, scale = self._register_of(
                monic, register if len(found) == 1 and power == 1 else None, total
            )
            total /= scale**power
            factors.append(Factor(place, power))
        return Split(total, tuple(factors))

    def _register_of(self, monic: fmpq_mpoly, own: int | None, constant: Fraction) -> tuple[int, Fraction]:
        """Return a register for a factor, and what it is times the factor; ``own`` is constant · factor."""
        key = str(self._polynomials.on_sphere(monic))
        if key not in self._registers:
            if own is not None:
                self._registers[key] = own, constant
            else:
                self._registers[key] = self._written(monic), Fraction(1)
        return self._registers[key]

    def _written(self, polynomial: fmpq_mpoly) -> int:
        builder, total = self._builder, -1
        for exponents, coefficient in polynomial.terms():
            term = builder.constant(as_fraction(coefficient))
            for variable, exponent in zip(_ORDER, exponents, strict=True):
                if exponent:
                    term = builder.multiply(term, builder.power(variable, Fraction(int(exponent))))
            total = term if total < 0 else builder.emit(Instruction("add", total, term))
        return total


Signs = tuple[int, ...]
"""One sign, 1 or -1, for each of the switches."""


@dataclass(frozen=True, slots=True)
class Switches:
    """A formula in normal form, with the registers whose signs distinguish its pieces.

    ``absolutes``: the arguments of absolute values, each different from g1 and g3, along which the octants
    are parted anyway. ``positives``: what has to be positive for the formula to have a value.
    """

    tape: Tape
    absolutes: tuple[int, ...]
    positives: tuple[int, ...]

    def argument(self, switch: int) -> Tape:
        """Return the tape of the argument of an absolute value."""
        builder, registers = copied(self.tape)
        return builder.tape(registers[self.absolutes[switch]])

    def divisors(self) -> tuple[Tape, ...]:
        """Return what the formula divides by, numbers apart."""
        builder, registers = copied(self.tape)
        found: dict[int, None] = {}
        for made in self.tape.instructions:
            if made.operation == "divide":
                found[registers[made.right]] = None
            elif made.operation == "power" and made.number is not None and made.number < 0:
                found[registers[made.left]] = None
        return tuple(builder.tape(register) for register in found)

    def on_piece(self, signs: Signs) -> Tape:
        """Return the formula with every absolute value written as plus or minus its argument."""
        return with_signs(self.tape, dict(zip(self.absolutes, signs, strict=True)))


def find_switches(tape: Tape) -> Switches:
    """Return the formula of ``tape`` (g1, g2, g3) in normal form, and its switches."""
    tape = normalise(tape)
    absolutes: dict[int, None] = {}
    positives: dict[int, None] = {}
    for instruction in tape.instructions:
        if _is_absolute(instruction):
            if instruction.left not in (0, 2):
                absolutes[instruction.left] = None
        elif needs_positive(instruction):
            positives[instruction.left] = None
    return Switches(tape, tuple(absolutes), tuple(positives))


def needs_positive(instruction: Instruction) -> bool:
    """Whether an instruction has a value for a positive left operand only, but perhaps for 0."""
    if instruction.operation == "power":
        return instruction.number is not None and instruction.number.denominator > 1
    return instruction.operation == "general_power" or (
        instruction.operation == "call" and instruction.name == "log"
    )


def normalise(tape: Tape) -> Tape:
    """Return a tape with the same values wherever ``tape`` is smooth, see the module."""
    builder, registers = TapeBuilder(tape.variables), {k: k for k in range(len(tape.variables))}
    writer = _Writer(builder)
    for register, instruction in enumerate(tape.instructions, start=len(tape.variables)):
        left = registers.get(instruction.left, -1)
        written: int | None = None
        if _is_absolute(instruction):
            written = writer.absolute(left)
        elif needs_positive(instruction):
            written = writer.of_positive(instruction, left, registers.get(instruction.right, -1))
        registers[register] = builder.again(instruction, registers) if written is None else written
    return builder.tape(registers[tape.result])


class _Writer:
    """Writes absolute values and even powers in normal form."""

    def __init__(self, builder: TapeBuilder) -> None:
        self._builder = builder
        self._polynomials = Polynomials(builder)

    def absolute(self, register: int) -> int:
        """Return the absolute value of a register, as a product of those of its factors."""
        split = self._polynomials.factors(register)
        if split is not None:
            return self._product_of(split)
        builder, made = self._builder, self._builder.instruction(register)
        match made:
            case Instruction("negate", left):
                return self.absolute(left)
            case Instruction("multiply", left, right):
                return builder.multiply(self.absolute(left), self.absolute(right))
            case Instruction("divide", left, right):
                return builder.divide(self.absolute(left), self.absolute(right))
            case Instruction("power", base, _, number) if number is not None:
                if number.denominator > 1:
                    return register
                if number % 2 == 0:
                    return register
                return builder.power(self.absolute(base), number)
            case Instruction("constant", number=number) if number is not None:
                return builder.constant(abs(number))
            case Instruction("call", name="exp" | "abs") | Instruction("general_power") | Instruction("pi"):
                return register
        return builder.call("abs", register)

    def of_positive(self, instruction: Instruction, base: int, right: int) -> int | None:
        """Return a root, logarithm or power with the even powers taken out; None if there are none."""
        builder = self._builder
        evens, rest = self._even_powers(base)
        if not evens:
            return None
        exponent = instruction.number
        if instruction.operation == "power" and exponent is not None:
            result = builder.constant(Fraction(1)) if rest is None else builder.power(rest, exponent)
            for absolute, power in evens:
                result = builder.multiply(builder.power(absolute, power * exponent), result)
            return result
        total: int | None = None if rest is None else builder.call("log", rest)
        for absolute, power in evens:
            term = builder.multiply(builder.constant(Fraction(power)), builder.call("log", absolute))
            total = term if total is None else builder.emit(Instruction("add", total, term))
        if total is None or instruction.operation == "call":
            return total
        return builder.call("exp", builder.multiply(right, total))

    def _even_powers(self, register: int) -> tuple[list[tuple[int, int]], int | None]:
        """Return (absolute value, even exponent) of what a base is the product of, and the rest of it."""
        builder = self._builder
        split = self._polynomials.factors(register)
        if split is not None:
            evens = [
                (builder.call("abs", f.register), f.power // 2 * 2) for f in split.factors if f.power > 1
            ]
            if not evens:
                return [], register
            odd = [f.register for f in split.factors if f.power % 2]
            rest = builder.constant(split.constant) if split.constant != 1 or not odd else None
            for factor in odd:
                rest = factor if rest is None else builder.multiply(rest, factor)
            return evens, None if split.constant == 1 and not odd else rest
        match builder.instruction(register):
            case Instruction("call", name="abs"):
                return [(register, 1)], None
            case Instruction("divide", left, right):
                evens, rest = self._even_powers(left)
                if not evens:
                    return [], register
                return evens, builder.divide(builder.constant(Fraction(1)) if rest is None else rest, right)
            case Instruction("multiply", left, right) if left == right:
                return [(self.absolute(left), 2)], None
            case Instruction("multiply", left, right):
                (evens, rest), (others, other) = self._even_powers(left), self._even_powers(right)
                if not evens and not others:
                    return [], register
                product = rest if other is None else other if rest is None else builder.multiply(rest, other)
                return evens + others, product
            case Instruction("power", base, _, number) if number is not None and number.denominator == 1:
                if number % 2 == 0:
                    return [(self.absolute(base), int(number))], None
        return [], register

    def _product_of(self, split: Split) -> int:
        """Return the absolute value of a product."""
        builder = self._builder
        result = builder.constant(abs(split.constant))
        for factor in split.factors:
            base = factor.register if factor.power % 2 == 0 else builder.call("abs", factor.register)
            result = builder.multiply(result, builder.power(base, Fraction(factor.power)))
        return result


def _is_absolute(instruction: Instruction) -> bool:
    return instruction.operation == "call" and instruction.name == "abs"
