"""Functions of a step's time as polynomials of balls, and truncated series: the algebras of a proven step.

A :data:`Curve` encloses a function f of τ ∈ [0, 1] pointwise: at every τ the ball Σ c_k τ^k contains f(τ).
What is known of f only up to a bound is in the radius of c_0, so sums and products of polynomials enclose
those of functions, and terms of high degree are folded into that radius. A division, a root or a
function is guessed as a truncated series, exact numbers, and the guess is held against its equation: the
residual, a polynomial again, bounds its error on the whole step (the Taylor models of Makino and Berz, in one
variable). So the length of a step is limited by the convergence of series, not by the width of a box.
"""

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from operator import mul

from flint import arb, arb_poly, arb_series

from service.dynamics.formula.algebras.ball import BallAlgebra, ball, series_of
from service.dynamics.formula.tape import Instruction
from workers.solvers.certified.validated.system import SystemProgram

Curve = arb_poly
"""See the chapter's beginning."""


class StepTooLongError(ArithmeticError):
    """The proof fails on this step; a shorter one may have it. Not for clients."""


def whole(curve: Curve) -> arb:
    """Return a ball that contains the curve for all |τ| ≤ 1."""
    return curve(arb(0, 1))


def size(curve: Curve) -> arb:
    """Return an upper bound of |curve| for |τ| ≤ 1."""
    bound = arb(whole(curve).abs_upper())
    if not bound.is_finite():
        raise StepTooLongError("a function is not bounded")
    return bound


def middles(series: arb_series | Curve) -> Curve:
    """Return the polynomial of the midpoints, which is exact."""
    return arb_poly([coefficient.mid() for coefficient in series.coeffs()])


class StepCurves:
    """StepCurves of degree ``degree``, and twice that between two operations; an Algebra.

    Raises
    ------
    StepTooLongError
        A denominator, a root's or a logarithm's argument or the argument of |x| may vanish in the step.
    """

    def __init__(self, degree: int) -> None:
        self._degree = degree
        self._inverses: dict[int, tuple[Curve, Curve]] = {}

    def constant(self, value: Fraction) -> Curve:
        """Return an exact number."""
        return arb_poly([ball(value)])

    def pi(self) -> Curve:
        """Return π."""
        return arb_poly([arb.pi()])

    def add(self, left: Curve, right: Curve) -> Curve:
        """Return left + right."""
        return left + right

    def subtract(self, left: Curve, right: Curve) -> Curve:
        """Return left - right."""
        return left - right

    def negate(self, operand: Curve) -> Curve:
        """Return -operand."""
        return -operand

    def multiply(self, left: Curve, right: Curve) -> Curve:
        """Return left · right."""
        product = left * right
        return product if product.length() <= 2 * self._degree + 1 else self.cut(product)

    def divide(self, left: Curve, right: Curve) -> Curve:
        """Return left / right."""
        return self.multiply(left, self._inverse(right))

    def power(self, base: Curve, exponent: Fraction) -> Curve:
        """Return base^exponent, which is ±1/2 or no multiple of it; the base is positive in the step."""
        if exponent.denominator > 2:
            return self._exp(self.multiply(self.constant(exponent), self._log(base)))
        root = self._inverse_root(base)
        return root if exponent < 0 else self.multiply(base, root)

    def general_power(self, base: Curve, exponent: Curve) -> Curve:
        """Return exp(exponent · log(base))."""
        return self._exp(self.multiply(exponent, self._log(base)))

    def call(self, name: str, argument: Curve) -> Curve:
        """Return the function of the curve."""
        if name == "exp":
            return self._exp(argument)
        if name == "log":
            return self._log(argument)
        if name in ("abs", "sign"):
            sign = whole(argument).sgn()
            if not sign.is_exact() or sign == 0:
                raise StepTooLongError("the argument of |x| may vanish")
            return argument * sign if name == "abs" else arb_poly([sign])
        sine, cosine = self._turned(argument)
        return sine if name == "sin" else cosine

    def cut(self, curve: Curve) -> Curve:
        """Return an enclosure of the curve of degree ``degree``."""
        rest = size(curve.right_shift(self._degree + 1))
        return curve.truncate(self._degree + 1) + arb(0, rest)

    def _guess(self, function: Callable[[arb_series], arb_series], curve: Curve) -> Curve:
        with series_of(self._degree + 1):
            return middles(function(arb_series(curve, self._degree + 1)))

    def _inverse(self, curve: Curve) -> Curve:
        """Return 1/curve: W/(1 − e) with the guess W and e = 1 − W·curve."""
        found = self._inverses.get(id(curve))
        if found is None:
            guess = self._guess(lambda series: 1 / series, curve)
            inverse = guess * (1 / _below_one(size(1 - guess * curve), "a denominator may vanish"))
            # The curve is in it so that no other gets its identity.
            found = self._inverses[id(curve)] = curve, inverse
        return found[1]

    def _inverse_root(self, curve: Curve) -> Curve:
        """Return curve^(−1/2): W (1 − e)^(−1/2) with the guess W and e = 1 − W²·curve; W has no zero then."""
        guess = self._guess(arb_series.rsqrt, curve)
        residual = 1 - self.multiply(guess, self.multiply(guess, curve))
        return guess * _below_one(size(residual), "the argument of a root may vanish").rsqrt()

    def _exp(self, curve: Curve) -> Curve:
        """Return exp u = exp U · exp(u − U), U being the midpoints: (E exp(−U))' = (E' − U' E) exp(−U)."""
        centre = middles(curve)
        guess = self._guess(arb_series.exp, centre)
        residual = size(guess.derivative() - centre.derivative() * guess)
        drift = arb(0, (residual * (-whole(centre)).exp()).abs_upper())
        ratio = guess(arb(0)) * (-centre(arb(0))).exp() + drift
        if not ratio > 0:
            raise StepTooLongError("the series of exp does not converge")
        return guess * (arb(0, size(curve - centre)).exp() / ratio)

    def _log(self, curve: Curve) -> Curve:
        """Return log u = log U + log(1 + (u − U)/U): (L − log U)' = (U L' − U')/U."""
        centre = middles(curve)
        least = arb(whole(centre).lower())
        if not least > 0:
            raise StepTooLongError("the argument of a logarithm may vanish")
        guess = self._guess(arb_series.log, centre)
        residual = size(centre * guess.derivative() - centre.derivative())
        error = guess(arb(0)) - centre(arb(0)).log() + arb(0, (residual / least).abs_upper())
        rest = arb(0, (size(curve - centre) / least).abs_upper())
        return guess - (error - (1 + rest).log())

    def _turned(self, curve: Curve) -> tuple[Curve, Curve]:
        """Return sin u and cos u: w = C + iS has (w exp(−iU))' = (w' − iU'w) exp(−iU)."""
        centre = middles(curve)
        sine = self._guess(arb_series.sin, centre)
        cosine = self._guess(arb_series.cos, centre)
        slope = centre.derivative()
        drift = size(cosine.derivative() + slope * sine) + size(sine.derivative() - slope * cosine)
        at = centre(arb(0))
        start = abs(sine(arb(0)) - at.sin()) + abs(cosine(arb(0)) - at.cos())
        error = arb(0, (drift + start + size(curve - centre)).abs_upper())
        return sine + error, cosine + error


def _below_one(residual: arb, fault: str) -> arb:
    """Return the ball of 1 − e, |e| ≤ residual, which must not contain 0."""
    if not residual < 1:
        raise StepTooLongError(fault)
    return 1 - arb(0, residual)


Rule = Callable[[int], arb]
"""Returns the coefficient of t^k of a register, given those of the ones before it and its own lower ones."""


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
