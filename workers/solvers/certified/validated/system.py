"""Autonomous systems y' = f(y) that can be integrated with proof, and the equations of a rigid body as one.

A system writes its right side once, over any algebra. It is recorded, with its Jacobian, as instructions
without zeros and without anything computed twice; these are run over series and over curves. The Taylor
series of a motion grows order by order.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from operator import mul
from typing import Protocol, TypeVar, cast

from flint import arb

from service.dynamics.body import RigidBody
from service.dynamics.defect.equations import rates_at, value_and_gradient
from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.programs import Traced, Tracer
from service.dynamics.formula.tape import Instruction, Operation, Tape

T = TypeVar("T")
Rule = Callable[[int], arb]
"""Returns the coefficient of t^k of a register, given those of the ones before it and its own lower ones."""


class System(Protocol):
    """An autonomous system of ordinary differential equations."""

    @property
    def dimension(self) -> int:
        """Number of variables."""

    def right_side(self, algebra: Algebra[T], state: Sequence[T]) -> Sequence[T]:
        """Return f(y), computed in ``algebra`` from as many variables."""


@dataclass(frozen=True, slots=True)
class SystemProgram:
    """Several results of one tape; None is a result that is 0."""

    tape: Tape
    results: tuple[int | None, ...]

    def run(self, algebra: Algebra[T], inputs: Sequence[T]) -> dict[int, T]:
        """Return the results at the inputs by their places, without those that are 0."""
        registers = self.tape.registers(algebra, inputs)
        return {place: registers[result] for place, result in enumerate(self.results) if result is not None}


@dataclass(frozen=True, slots=True)
class Recorded:
    """The programs of a system."""

    dimension: int
    right_side: SystemProgram
    jacobian: SystemProgram
    """Its results are ∂f_i/∂y_j, row by row."""


def record(system: System) -> Recorded:
    """Return the programs of a system."""
    count = system.dimension
    tracer = _ZeroTracer()
    inputs = [tracer.variable(f"y{number}") for number in range(count)]
    jets = FirstOrderJets[Traced](tracer, count)
    found = system.right_side(jets, jets.variables(inputs))
    values = [jet.value for jet in found]
    slopes = [slope for jet in found for slope in jet.first]
    return Recorded(count, _program(tracer, inputs, values), _program(tracer, inputs, slopes))


class _ZeroTracer(Tracer):
    """A tracer with few operations, without terms and factors that are 0 and factors of 1: V may lack any."""

    def __init__(self) -> None:
        super().__init__()
        self.zero = self.constant(Fraction(0))
        self._one = self.constant(Fraction(1))

    def add(self, left: Traced, right: Traced) -> Traced:
        """Return left + right."""
        return right if left is self.zero else left if right is self.zero else super().add(left, right)

    def subtract(self, left: Traced, right: Traced) -> Traced:
        """Return left - right."""
        if left is self.zero:
            return self.negate(right)
        return left if right is self.zero else super().subtract(left, right)

    def multiply(self, left: Traced, right: Traced) -> Traced:
        """Return left · right."""
        if left is self.zero or right is self.zero:
            return self.zero
        return left if right is self._one else right if left is self._one else super().multiply(left, right)

    def divide(self, left: Traced, right: Traced) -> Traced:
        """Return left / right; by a constant as a product."""
        step = self._steps[right.number]
        if step.operation == "constant" and step.number:
            return self.multiply(self.constant(1 / step.number), left)
        return super().divide(left, right)

    def negate(self, operand: Traced) -> Traced:
        """Return -operand."""
        return operand if operand is self.zero else super().negate(operand)

    def power(self, base: Traced, exponent: Fraction) -> Traced:
        """Return base^exponent by products, quotients and powers that are no multiples of 1/2 but ±1/2."""
        numerator, denominator = exponent.as_integer_ratio()
        if denominator > 2:
            return super().power(base, exponent)
        if denominator == 2:
            base = super().power(base, Fraction(1 if numerator > 0 else -1, 2))
        power = base
        for digit in bin(abs(numerator))[3:]:
            power = self.multiply(power, power)
            power = self.multiply(power, base) if digit == "1" else power
        return power if denominator == 2 or numerator > 0 else self.divide(self._one, power)

    def call(self, name: str, argument: Traced) -> Traced:
        """Return the function; tan as a quotient."""
        if name != "tan":
            return super().call(name, argument)
        return self.divide(super().call("sin", argument), super().call("cos", argument))


def _program(
    tracer: _ZeroTracer, inputs: Sequence[Traced], results: Sequence[Traced | None]
) -> SystemProgram:
    wanted = [None if each is None or each is tracer.zero else each for each in results]
    registers = {each.number: register for register, each in enumerate(inputs)} | {-1: -1}
    written: list[Instruction] = []
    for number, step in tracer.steps([each for each in wanted if each is not None]):
        if step.operation != "variable":
            registers[number] = len(inputs) + len(written)
            operation = cast("Operation", step.operation)
            left, right = registers[step.left], registers[step.right]
            written.append(Instruction(operation, left, right, step.number, step.name))
    names = tuple(f"y{number}" for number in range(len(inputs)))
    places = tuple(None if each is None else registers[each.number] for each in wanted)
    return SystemProgram(Tape(names, tuple(written), -1), places)


@dataclass(frozen=True, slots=True)
class EulerPoisson:
    """The six variables (p, q, r, g1, g2, g3) of a body in the field of V, a tape over g1, g2, g3."""

    body: RigidBody
    potential: Tape

    @property
    def dimension(self) -> int:
        """Number of variables."""
        return 6

    def right_side(self, algebra: Algebra[T], state: Sequence[T]) -> Sequence[T]:
        """Return I⁻¹ (Iω × ω + γ × ∇V) and γ × ω."""
        _, gradient = value_and_gradient(algebra, self.potential, state[3:6])
        return rates_at(algebra, self.body, state, gradient)


@dataclass(frozen=True, slots=True)
class TurningBody:
    """The six variables, then the quaternion of the attitude and the azimuths of some axes of the body.

    See :mod:`service.dynamics.equations.orientation`: q̇ = q ω/2, ψ̇_k = (ω·γ − ω_k γ_k)/(1 − γ_k²).
    """

    motion: EulerPoisson
    axes: tuple[int, ...]
    """0 for ψ1, 2 for ψ3: those whose axis does not become vertical."""

    @property
    def dimension(self) -> int:
        """Number of variables."""
        return 10 + len(self.axes)

    def right_side(self, algebra: Algebra[T], state: Sequence[T]) -> Sequence[T]:
        """Return the rates of all of them."""
        omega, gamma, (a, b, c, d) = state[:3], state[3:6], state[6:10]
        p, q, r = omega
        half, one = algebra.constant(Fraction(1, 2)), algebra.constant(Fraction(1))

        def total(*products: tuple[T, T]) -> T:
            found = algebra.multiply(*products[0])
            for product in products[1:]:
                found = algebra.add(found, algebra.multiply(*product))
            return found

        minus = algebra.negate
        turn = (
            total((minus(b), p), (minus(c), q), (minus(d), r)),
            total((a, p), (c, r), (minus(d), q)),
            total((a, q), (d, p), (minus(b), r)),
            total((a, r), (b, q), (minus(c), p)),
        )
        others = [[k for k in range(3) if k != axis] for axis in self.axes]
        azimuths = [
            algebra.divide(
                total(*((omega[k], gamma[k]) for k in pair)),
                algebra.subtract(one, algebra.multiply(gamma[axis], gamma[axis])),
            )
            for axis, pair in zip(self.axes, others, strict=True)
        ]
        rates = self.motion.right_side(algebra, state[:6])
        return (*rates, *(algebra.multiply(half, each) for each in turn), *azimuths)


def grow(program: SystemProgram, start: Sequence[arb], order: int) -> list[list[arb]]:
    """Return the Taylor coefficients of y' = f(y) from an exact start up to t^``order``, as exact numbers.

    Nothing is enclosed here. Each order is computed from the lower ones: with 36 terms in half, with 143
    in a tenth of the time that series take which are multiplied as a whole, as one that is not known yet
    needs as many times as it has terms.
    """
    registers: list[list[arb]] = [[value] for value in start]
    rules: list[Rule] = []
    count, instructions = len(start), program.tape.instructions
    for instruction in instructions:
        registers.append([])
        is_scaled = instruction.left >= count and instructions[instruction.left - count].number is not None
        rules.append(_rule(instruction, registers, is_scaled=is_scaled))
    growing = list(zip(registers[count:], rules, strict=True))
    for k in range(order):
        for series, rule in growing:
            series.append(rule(k))
        for series, result in zip(registers[:count], program.results, strict=True):
            series.append(arb(0) if result is None else (registers[result][k] / (k + 1)).mid())
    return registers[:count]


def _dot(left: Iterable[arb], right: Iterable[arb]) -> arb:
    return sum(map(mul, left, right), arb(0))


def _rule(instruction: Instruction, registers: list[list[arb]], *, is_scaled: bool) -> Rule:
    operation, left, right, number, name = instruction
    x, y, own = registers[left], registers[right], registers[-1]
    match operation:
        case "constant" | "pi":
            value = arb.pi() if number is None else ball(number)
            return lambda k: arb(0) if k else value
        case "add":
            return lambda k: x[k] + y[k]
        case "subtract":
            return lambda k: x[k] - y[k]
        case "negate":
            return lambda k: -x[k]
        case "multiply" if is_scaled:
            return lambda k: x[0] * y[k]
        case "multiply":
            return lambda k: _dot(x, reversed(y))
        case "divide":
            return lambda k: (x[k] - _dot(own, y[k:0:-1])) / y[0]
        case "power":
            assert number is not None
            return _power_rule(x, own, number)
    return _call_rule(name, x, own)


def _power_rule(x: list[arb], own: list[arb], exponent: Fraction) -> Rule:
    """Return the rule of a power: k x_0 c_k = Σ (e j − (k − j)) x_j c_(k−j), from x c' = e x' c."""
    e = ball(exponent)

    def coefficient(k: int) -> arb:
        if k == 0:
            return BallAlgebra().power(x[0], exponent)
        weighted = (c * (e * j - (k - j)) for j, c in zip(range(1, k + 1), reversed(own), strict=True))
        return _dot(x[1:], weighted) / (k * x[0])

    return coefficient


def _call_rule(name: str, x: list[arb], own: list[arb]) -> Rule:
    slopes: list[arb] = []
    """j x_j from j = 1 on."""
    other: list[arb] = []
    """The cosine beside a sine, and the reverse."""
    partner, sign = {"sin": ("cos", -1), "cos": ("sin", 1)}.get(name, ("", 0))

    def coefficient(k: int) -> arb:
        if k == 0:
            if partner:
                other.append(BallAlgebra().call(partner, x[0]))
            return BallAlgebra().call(name, x[0])
        if name in ("abs", "sign"):
            return x[k] * x[0].sgn() if name == "abs" else arb(0)
        if name == "log":
            own_slopes = (j * c for j, c in zip(range(1, k), own[1:], strict=True))
            return (x[k] - _dot(own_slopes, x[k - 1 : 0 : -1]) / k) / x[0]
        slopes.append(k * x[k])
        if name == "exp":
            return _dot(slopes, reversed(own)) / k
        value = -sign * _dot(slopes, reversed(other)) / k
        other.append(sign * _dot(slopes, reversed(own)) / k)
        return value

    return coefficient
