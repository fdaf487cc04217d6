"""Simplifies a formula's program: merges equal parts and removes identical cancellations; and half angles.

Registers are written as exact polynomials in g1, g2, g3 first.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from fractions import Fraction

from flint import Ordering, fmpq, fmpq_mpoly, fmpq_mpoly_ctx, fmpq_poly

from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.formula.tape import Instruction, Recorder, Tape, without_unused
from service.dynamics.formula.tree import (
    Binary,
    BinaryOperator,
    Call,
    Negation,
    Number,
    Tree,
    children,
    fold_tree,
)

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


class TapeBuilder(Recorder):
    """Instructions appended one by one, simplified where that is free."""

    def constant(self, value: Fraction) -> int:
        """Return a number."""
        return self.emit(Instruction("constant", number=value))

    def negate(self, register: int) -> int:
        """Return minus a register; twice is the register itself."""
        made = self.instruction(register)
        if made is not None and made.operation == "negate":
            return made.left
        return self.emit(Instruction("negate", register))

    def multiply(self, left: int, right: int) -> int:
        """Return a product; a factor 1 is left out."""
        for one, other in ((left, right), (right, left)):
            made = self.instruction(one)
            if made is not None and made.operation == "constant" and made.number == 1:
                return other
        return self.emit(Instruction("multiply", left, right))

    def divide(self, left: int, right: int) -> int:
        """Return a quotient; x/x is 1, (-x)/x is -1 and x y/x is y, wherever they have a value."""
        if left == right:
            return self.constant(Fraction(1))
        if self.negate(left) == right or self.negate(right) == left:
            return self.constant(Fraction(-1))
        made = self.instruction(left)
        if made is not None and made.operation == "multiply":
            for one, other in ((made.left, made.right), (made.right, made.left)):
                if one == right:
                    return other
                if self.negate(one) == right or self.negate(right) == one:
                    return self.negate(other)
        if made is not None and made.operation == "negate":
            inner = self.instruction(made.left)
            if inner is not None and inner.operation == "multiply":
                return self.negate(self.divide(made.left, right))
        return self.emit(Instruction("divide", left, right))

    def power(self, base: int, exponent: Fraction) -> int:
        """Return base^exponent."""
        if exponent == 0:
            return self.constant(Fraction(1))
        return base if exponent == 1 else self.emit(Instruction("power", base, number=exponent))

    def call(self, name: str, argument: int) -> int:
        """Return the function of a register."""
        return self.emit(Instruction("call", argument, name=name))

    def again(self, instruction: Instruction, registers: Mapping[int, int]) -> int:
        """Append an instruction of another tape, whose registers became ``registers``."""
        left, right = registers.get(instruction.left, -1), registers.get(instruction.right, -1)
        if instruction.operation == "negate":
            return self.negate(left)
        if instruction.operation == "divide":
            return self.divide(left, right)
        return self.emit(instruction._replace(left=left, right=right))

    def tape(self, result: int) -> Tape:
        """Return the tape of a register."""
        return without_unused(self.whole(result))


def with_signs(tape: Tape, signs: Mapping[int, int]) -> Tape:
    """Return a tape with the absolute values of some registers written as plus or minus the register."""
    return with_sides(tape, signs, ())


def with_sides(tape: Tape, signs: Mapping[int, int], growing: Collection[int]) -> Tape:
    """Return a tape for where some registers have these signs, and others, ``growing``, are positive.

    |x| is x or −x there; a/(b + exp x) is a exp(−x)/(b exp(−x) + 1), anywhere, which does not overflow.
    """
    builder = TapeBuilder(tape.variables)
    registers = {register: register for register in range(len(tape.variables))}
    for register, made in enumerate(tape.instructions, start=len(tape.variables)):
        sign = signs.get(made.left) if made.operation == "call" and made.name == "abs" else None
        split = exponential_in(tape, made.right) if made.operation == "divide" else None
        if sign is not None:
            argument = registers[made.left]
            registers[register] = argument if sign > 0 else builder.negate(argument)
        elif split is not None and split[0] in growing:
            decaying = builder.call("exp", builder.negate(registers[split[0]]))
            rest = builder.multiply(registers[split[1]], decaying)
            below = builder.emit(Instruction("add", rest, builder.constant(Fraction(1))))
            above = builder.multiply(registers[made.left], decaying)
            registers[register] = builder.emit(Instruction("divide", above, below))
        else:
            registers[register] = builder.again(made, registers)
    return builder.tape(registers[tape.result])


def exponential_in(tape: Tape, register: int) -> tuple[int, int] | None:
    """Return the registers (x, b) of exp x + b, None for another one."""

    def made_by(register: int) -> Instruction | None:
        place = register - len(tape.variables)
        return None if place < 0 else tape.instructions[place]

    total = made_by(register)
    if total is None or total.operation != "add":
        return None
    for one, other in ((total.left, total.right), (total.right, total.left)):
        made = made_by(one)
        if made is not None and made.operation == "call" and made.name == "exp":
            return made.left, other
    return None


def copied(tape: Tape) -> tuple[TapeBuilder, dict[int, int]]:
    """Return a builder that holds a tape, and what its registers became."""
    builder = TapeBuilder(tape.variables)
    registers = {register: register for register in range(len(tape.variables))}
    for register, made in enumerate(tape.instructions, start=len(tape.variables)):
        registers[register] = builder.again(made, registers)
    return builder, registers


def known_at_poles(tape: Tape) -> Tape:
    """Return a tape with g1² + g3² for the factor 1 − g2² of sums in g2 alone: equal on the sphere.

    Next to a pole doubles know the one to their last digit, and nothing of the other.
    """
    builder = TapeBuilder(tape.variables)
    polynomials = RegisterPolynomials(builder, (2, 0, 1))
    g2 = polynomials.context.gens()[2]
    registers = {register: register for register in range(len(tape.variables))}
    for register, made in enumerate(tape.instructions, start=len(tape.variables)):
        registers[register] = builder.again(made, registers)
        if made.operation not in ("add", "subtract"):
            continue
        polynomial = polynomials.of(registers[register])
        if polynomial is None or any(third or first for third, first, _ in polynomial.monoms()):
            continue
        quotient, rest = divmod(polynomial, 1 - g2 * g2)
        if quotient and not rest:
            first, third = (builder.power(variable, Fraction(2)) for variable in (0, 2))
            total = builder.emit(Instruction("add", first, third))
            registers[register] = builder.multiply(total, _horner(builder, quotient))
    return builder.tape(registers[tape.result])


def _horner(builder: TapeBuilder, polynomial: fmpq_mpoly) -> int:
    """Return the register of a polynomial in g2."""
    coefficients = {int(power): Fraction(int(x.p), int(x.q)) for (*_, power), x in polynomial.terms()}
    degree = max(coefficients)
    total = builder.constant(coefficients[degree])
    for power in range(degree - 1, -1, -1):
        total = builder.multiply(total, 1)
        if power in coefficients:
            total = builder.emit(Instruction("add", total, builder.constant(coefficients[power])))
    return total


def with_half_angles(tree: Tree) -> Tree:
    """Return the formula with k (1 - cos x) as 2 k sin(x/2)² where it divides, or under a logarithm.

    It is the same tree where there is none.
    """
    return fold_tree(tree, _halved)[0]


def _halved(_: int, node: Tree, operands: Sequence[tuple[Tree, Tree]]) -> tuple[Tree, Tree]:
    """Return a node rewritten where it divides, and rewritten all over; ``operands`` are alike."""
    plain, all_over = ([each[k] for each in operands] for k in (0, 1))
    whole = _remade(node, all_over)
    if isinstance(node, Binary):
        whole = _of_half_angle(node.operator, all_over[0], all_over[1]) or whole
        if node.operator == "/":
            plain[1] = all_over[1]
        elif node.operator == "^" and _is_negative(node.right):
            plain[0] = all_over[0]
    elif isinstance(node, Call) and node.function == "log":
        plain = all_over
    return _remade(node, plain), whole


def _is_negative(exponent: Tree) -> bool:
    """Tell whether an exponent is written with a sign before it."""
    while isinstance(exponent, Binary):
        exponent = exponent.left
    return isinstance(exponent, Negation)


def _remade(node: Tree, operands: Sequence[Tree]) -> Tree:
    """Return the node with other operands, itself if they are its own."""
    if all(one is other for one, other in zip(operands, children(node), strict=True)):
        return node
    if isinstance(node, Binary):
        return Binary(node.operator, operands[0], operands[1])
    return Call(node.function, operands[0]) if isinstance(node, Call) else Negation(operands[0])


def _of_half_angle(operator: BinaryOperator, left: Tree, right: Tree) -> Tree | None:
    """Return 2 k sin(x/2)² for a sum or a difference that is k (1 - cos x), None for another."""
    if operator not in ("+", "-"):
        return None
    for number, cosine, is_turned in ((left, right, operator == "-"), (right, left, False)):
        k = _number(number)
        k = -k if k is not None and number is right and operator == "-" else k
        found = _times_cosine(cosine)
        if k is None or found is None:
            continue
        argument, factor = found
        if k != 0 and k == (factor if is_turned else -factor):
            sine = Call("sin", Binary("/", argument, Number(Fraction(2))))
            square = Binary("*", Number(2 * abs(k)), Binary("^", sine, Number(Fraction(2))))
            return square if k > 0 else Negation(square)
    return None


def _number(node: Tree) -> Fraction | None:
    if isinstance(node, Negation):
        value = _number(node.operand)
        return None if value is None else -value
    return node.value if isinstance(node, Number) else None


def _times_cosine(node: Tree) -> tuple[Tree, Fraction] | None:
    """Return x and k for k cos x, None for another node."""
    if isinstance(node, Negation):
        found = _times_cosine(node.operand)
        return None if found is None else (found[0], -found[1])
    if isinstance(node, Call) and node.function == "cos":
        return node.argument, Fraction(1)
    if isinstance(node, Binary) and node.operator == "*":
        for one, other in ((node.left, node.right), (node.right, node.left)):
            factor = _number(one)
            if factor is not None and isinstance(other, Call) and other.function == "cos":
                return other.argument, factor
    return None
