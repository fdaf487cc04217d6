"""The loop of a planar motion at real v, in real balls, for many points of one motion."""

import operator
from collections.abc import Callable, Sequence

from flint import arb

from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.tape import Instruction, Tape
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.geometry.point import BALLS, make_equator
from workers.solvers.complex_plane.complex_loop import MANY, geometric

_Step = tuple[Callable[[arb, arb], arb], int, int]
_ARITHMETIC: dict[str, Callable[[arb, arb], arb]] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
}
NEAR = 2.0**-10
_BALLS = BallAlgebra()
_JETS = FirstOrderJets(_BALLS, 1)


class PreparedTape:
    """A tape over balls of one precision: its constants are there already, one function for each step."""

    def __init__(self, tape: Tape) -> None:
        self._inputs, self._constants = len(tape.variables), list[arb]()
        self._steps: list[_Step] = []
        places: dict[int, int] = {}
        constants = [k for k, each in enumerate(tape.instructions) if each.operation in ("constant", "pi")]
        for k, each in enumerate(tape.instructions):
            if k in constants:
                places[self._inputs + k] = self._inputs + len(self._constants)
                number = each.number
                self._constants.append(_BALLS.pi() if number is None else _BALLS.constant(number))
        for k, each in enumerate(tape.instructions):
            if k not in constants:
                left, right = (places.get(register, register) for register in (each.left, each.right))
                places[self._inputs + k] = self._inputs + len(self._constants) + len(self._steps)
                self._steps.append(_step(each, left, right))
        self._result = places.get(tape.result, tape.result)

    def __call__(self, inputs: Sequence[arb]) -> arb:
        """Return the value at ``inputs``, one per variable."""
        registers = [*inputs, *self._constants]
        for function, left, right in self._steps:
            registers.append(function(registers[left], registers[right]))
        return registers[self._result]


class RealLoop:
    """The functions of ComplexLoop at real v with sin v ≠ 0 and cos v ≠ 0; for one precision."""

    def __init__(self, loop: Loop, tape: Tape, side: int) -> None:
        self._side, self._mirrored = side, loop.mirrored
        self._tape, self._potential = tape, PreparedTape(tape)
        alpha = loop.alpha
        self._power = alpha.numerator - 1
        self._is_summed = alpha.denominator == 1 and (alpha <= MANY or side == 0)
        self._alpha, self._first, self._third = ball(alpha), loop.g1_sign * loop.G, loop.Z
        self._equator = make_equator(loop.Z, loop.G, self._alpha)
        self._Z_squared, self._G_squared = self._equator.Z_squared, self._equator.G_squared
        A, C = ball(loop.A), ball(loop.C)
        # With E = C + A (G/Z)² w^(α−1) is 1/P = A E / (2 C N).
        self._C, self._steepness = C, A * self._G_squared / self._Z_squared
        self._factor = self._Z_squared * A / (2 * C)

    def V(self, v: arb) -> arb:
        """Return the potential."""
        return self._potential(self.gamma(v))

    def squared_rate(self, v: arb, h: arb) -> arb:
        """Return (dt/dv)² = Z²/(c² P)."""
        sine, cosine = v.sin_cos()
        power, size, c_squared = self._powers(sine, cosine)
        N = h - self._potential(self._gamma(sine, cosine, size, c_squared.sqrt()))
        return self._factor * (self._C + self._steepness * power * power) / (c_squared * N)

    def slope(self, v: arb) -> arb:
        """Return dV/dv."""
        sine, cosine = v.sin_cos()
        power, size, c_squared = self._powers(sine, cosine)
        c = c_squared.sqrt()
        # d|sin v|/dv is cos v with the sign of sin v.
        rising = cosine if sine > 0 else -cosine
        first = self._first * self._alpha * power * rising
        second = -sine * self._Z_squared * (self._C + self._steepness * power * power) / (self._C * c)
        rates = (first, second, self._third * cosine)
        gamma = self._gamma(sine, cosine, size, c)
        inputs = [
            _JETS.seed(value, (rate,))
            for value, rate in zip(gamma, rates[::-1] if self._mirrored else rates, strict=True)
        ]
        return _JETS.gradient(self._tape.evaluate(_JETS, inputs))[0]

    def gamma(self, v: arb) -> tuple[arb, arb, arb]:
        """Return g1, g2, g3 in the client's axes."""
        sine, cosine = v.sin_cos()
        _, size, c_squared = self._powers(sine, cosine)
        return self._gamma(sine, cosine, size, c_squared.sqrt())

    def state(self, v: arb, speed: arb) -> tuple[arb, ...]:
        """Return (p, q, r, g1, g2, g3) in the client's axes from v and dv/dt."""
        sine, cosine = v.sin_cos()
        power, size, c_squared = self._powers(sine, cosine)
        c = c_squared.sqrt()
        p = -self._third * speed / c
        # r/p = −A g1 / (C g3).
        r = -self._alpha * self._first / self._third * power * sine.sgn() * p
        g1, g2, g3 = self._gamma(sine, cosine, size, c)
        return (-r, arb(0), -p, g1, g2, g3) if self._mirrored else (p, arb(0), r, g1, g2, g3)

    def _gamma(self, sine: arb, cosine: arb, size: arb, c: arb) -> tuple[arb, arb, arb]:
        g1, g2, g3 = self._first * size, c * cosine, self._third * sine
        return (g3, g2, g1) if self._mirrored else (g1, g2, g3)

    def loses_digits(self, v: arb) -> bool:
        """Say whether v is too near the equator, or a pole, for the formulas here."""
        sine, cosine = v.sin_cos()
        near = sine if self._is_summed else cosine
        return not abs(near) > NEAR

    def _powers(self, sine: arb, cosine: arb) -> tuple[arb, arb, arb]:
        """Return |sin v|^(α−1), |sin v|^α and c²."""
        size = sine if self._side > 0 else -sine if self._side else abs(sine)
        if self._is_summed:
            power, quotient = size**self._power, geometric(sine * sine, self._power + 1)
            c_squared = self._Z_squared + self._G_squared * quotient
        else:
            u = cosine * cosine
            log = BALLS.log_sine(size, u)
            power = ((self._alpha - 1) * log).exp()
            c_squared = BALLS.c_squared(self._equator, log, u)
        return power, power * size, c_squared


def _step(instruction: Instruction, left: int, right: int) -> _Step:
    operation, number, name = instruction.operation, instruction.number, instruction.name
    if operation in _ARITHMETIC:
        return _ARITHMETIC[operation], left, right
    if operation == "general_power":
        return _BALLS.general_power, left, right
    if operation == "negate":
        return lambda x, _: -x, left, left
    if operation == "call":
        return lambda x, _: _BALLS.call(name, x), left, left
    if number == 2:
        return operator.mul, left, left
    assert number is not None
    return lambda x, _: _BALLS.power(x, number), left, left
