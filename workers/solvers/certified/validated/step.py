r"""One proven step: where the motion from an exact point is, and how its neighbours move beside it.

A :data:`Curve` encloses a function f of τ ∈ [0, 1] pointwise: at every τ the ball Σ c_k τ^k contains f(τ).
What is known of f only up to a bound is in the radius of c_0, so sums and products of polynomials enclose
those of functions, and terms of high degree are folded into that radius. A division, a root or a
function is guessed as a truncated series, exact numbers, and the guess is held against its equation: the
residual, a polynomial again, bounds its error on the whole step (the Taylor models of Makino and Berz, in one
variable). So the length of a step is limited by the convergence of series, not by the width of a box.

A polynomial P of high order is computed from the point, P(0), and taken as it is: exact numbers. Its defect
d = P' − f(P) is bounded on the whole step by curves, and so is the Jacobian J of f in a tube
about P. With |J| ≤ K, number by number, a motion that starts within r of P(0) stays within

.. math:: e^{hK} r + h\,\varphi_1(hK)\,|d|, \qquad \varphi_1(z) = (e^z - 1)/z,

of P as long as that is inside the tube, hence to the end: the mean value of J between two points of the tube
is bounded by K. This proves too that f has no singularity there. The same bound for the variational equation
M' = J M, whose solution is guessed in doubles as a polynomial of low order, encloses the derivative of the
flow on the whole tube; only this multiplies the errors of earlier steps (Lohner). Sizes of errors are doubles
rounded upwards, in units of 2^−precision, so that no precision underflows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import arb, arb_poly, arb_series, ctx
from numpy.typing import NDArray

from service.dynamics.formula.algebras.ball import ball, series_of
from workers.solvers.certified.validated.system import Recorded, grow

FloatArray = NDArray[np.float64]
Curve = arb_poly
"""See the chapter's beginning."""
FLOW_DEGREE = 24
"""Degree in time of the derivative of the flow: it has all digits of doubles where series fall like 4^−k."""
FLOW_BITS = 64
"""Precision of the Jacobian's curves; they are then cut to doubles."""
ROUND_UP = 1.0 + 2.0**-40
"""More than all roundings of the sums of at most 2^10 doubles ≥ 0 and of their products below."""
SUM_ROUNDING = 2.0**-44
"""Bound of the rounding errors of sums of at most 2^8 products, relative to the sum of their sizes."""
MAX_ROW_SUM = 10.0
"""Steps are so short that no row of hK has a larger sum, in fit units: bounds grow with its exponential."""
TUBE_WIDENING = 2.0**8
"""The tube is so many times wider than what enters it."""
UNDERFLOW = 1e-300
"""Added to what may have underflown."""


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


@dataclass(frozen=True, slots=True)
class Taylor:
    """The polynomial of a step before its length is known: coefficients of powers of the time since it."""

    coefficients: tuple[tuple[arb, ...], ...]
    """One row per variable."""
    longest: Fraction
    """Length up to which the terms that are left out are about 2^−precision."""


@dataclass(frozen=True, slots=True)
class ProvenStep:
    """A proven step from ``begin`` on, of signed length ``length``; τ = (t − begin)/length is in [0, 1]."""

    begin: Fraction
    length: Fraction
    curves: tuple[Curve, ...]
    """P, with exact coefficients."""
    error: FloatArray
    """Bound of |y − P| of the motion from P(0), in units of 2^−precision, shape (d,)."""
    flow: FloatArray
    """Coefficients of the derivative of the flow, shape (FLOW_DEGREE + 1, d, d)."""
    flow_error: FloatArray
    """Its bound, for all τ and all starts in the tube, shape (d, d)."""
    spread: FloatArray
    """Bound of |y − P| of all motions from within the radius of the start, in the same units."""


def taylor(system: Recorded, point: Sequence[arb], order: int) -> Taylor:
    """Return the Taylor polynomial of the motion from an exact point, as exact numbers.

    Raises
    ------
    StepTooLongError
        f has no series there.
    """
    rows = [tuple(row) for row in grow(system.right_side, point, order)]
    if not all(c.is_finite() for row in rows for c in row):
        raise StepTooLongError("the equations have no series where the step begins")
    sizes = [max(1.0, abs(float(start))) for start in point]
    return Taylor(tuple(rows), _longest(rows, sizes, order))


def _longest(rows: Sequence[tuple[arb, ...]], sizes: Sequence[float], order: int) -> Fraction:
    """Return about the length h at which the last two terms are 2^−precision, a number of few bits."""
    logarithms = []
    for k in (order - 1, order):
        largest = max((abs(row[k]) / scale for row, scale in zip(rows, sizes, strict=True)), key=float)
        if largest > 0:
            logarithms.append((-ctx.prec - _log2(largest)) / k)
    return rounded_length(2.0 ** min(logarithms)) if logarithms else Fraction(2) ** 64


def _log2(value: arb) -> float:
    return float(value.log() / arb.const_log2())


def rounded_length(length: float) -> Fraction:
    """Return a number of ten bits just below, so that places of steps are short numbers."""
    mantissa, exponent = np.frexp(length)
    return Fraction(int(mantissa * 1024)) * Fraction(2) ** (int(exponent) - 10)


def prove(
    system: Recorded, found: Taylor, begin: Fraction, length: Fraction, radius: FloatArray
) -> ProvenStep:
    """Return the step of this length from within ``radius`` of the polynomial's start.

    Raises
    ------
    StepTooLongError
        The proof fails.
    """
    order, unit = len(found.coefficients[0]) - 1, arb(2) ** -ctx.prec
    powers, h = [arb(1)], ball(length)
    for _ in range(order):
        powers.append(powers[-1] * h)
    curves = tuple(
        arb_poly([(c * power).mid() for c, power in zip(row, powers, strict=True)])
        for row in found.coefficients
    )
    rates = system.right_side.run(StepCurves(order), curves)
    missed = [curve.derivative() - h * rates.get(row, arb_poly()) for row, curve in enumerate(curves)]
    defect = np.array([upper(size(each) / unit) for each in missed])
    tube = TUBE_WIDENING * (radius + defect) + 1.0
    jacobian, rest = _jacobian(system, curves, h, [unit * width for width in tube.tolist()])
    K = ROUND_UP * (np.abs(jacobian).sum(axis=0) + rest)
    exponential, phi = _bounds(K)
    error = ROUND_UP * (phi @ defect)
    spread = ROUND_UP * (exponential @ radius + error)
    if not np.all(spread < tube):
        # e^K is above TUBE_WIDENING.
        raise StepTooLongError("the motion may leave the tube")
    flow, flow_error = _flow(jacobian, rest, phi)
    return ProvenStep(begin, length, curves, error, flow, flow_error, spread)


def upper(value: arb) -> float:
    """Return a double that is not below |value|."""
    bound = float(arb(value.abs_upper()))
    if not bound < np.inf:
        raise StepTooLongError("a number is not bounded")
    return bound * ROUND_UP + UNDERFLOW


def _jacobian(
    system: Recorded, curves: Sequence[Curve], h: arb, tube: Sequence[arb]
) -> tuple[FloatArray, FloatArray]:
    """Return h J in the tube: coefficients (FLOW_DEGREE + 1, d, d), and a bound of what they lack (d, d)."""
    count = system.dimension
    coefficients = np.zeros((FLOW_DEGREE + 1, count, count))
    rest = np.zeros((count, count))
    with ctx.workprec(FLOW_BITS):
        algebra = StepCurves(FLOW_DEGREE)
        wide = [algebra.cut(curve) + arb(0, width) for curve, width in zip(curves, tube, strict=True)]
        for place, entry in system.jacobian.run(algebra, wide).items():
            row, column = divmod(place, count)
            terms = (algebra.cut(entry) * h).coeffs()
            coefficients[: len(terms), row, column] = [float(term) for term in terms]
            radii = sum((term.rad() for term in terms), arb(0))
            rest[row, column] = upper(arb(radii)) + SUM_ROUNDING * np.abs(coefficients[:, row, column]).sum()
    if not np.isfinite(coefficients).all():
        raise StepTooLongError("the Jacobian is not bounded")
    return coefficients, rest


def _bounds(K: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return upper bounds of e^K and (e^K − 1)/K for a matrix of numbers ≥ 0.

    In units of the variables in which the sums of its rows are about equal: its eigenvector ≥ 0, nearly.
    """
    power = np.eye(len(K)) + K
    for _ in range(4):
        power = power @ power
        power = power / power.max()
    units = np.exp2(np.round(np.log2(power.sum(axis=1).clip(UNDERFLOW))))
    scaled = K * units / units[:, None]
    if not scaled.sum(axis=1).max() <= MAX_ROW_SUM:
        raise StepTooLongError("neighbours may part too fast")
    term = phi = np.eye(len(K))
    for k in range(1, 8 * int(MAX_ROW_SUM)):
        term = term @ scaled / k
        phi = phi + term / (k + 1)
    # What is left is below a geometric series of ratio 1/8 from a term whose rows' sums are below 1e-38.
    phi = ROUND_UP * (phi + 1e-30) * units[:, None] / units
    return ROUND_UP * (np.eye(len(K)) + K @ phi), phi


def _flow(jacobian: FloatArray, rest: FloatArray, phi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return M, M(0) = 1, and a bound of its error from the defect of M' = h J M."""
    count, last = len(rest), len(jacobian) - 1
    # (i, a, b) → (a, i b), the highest power first: one product per coefficient.
    reversed_rows = jacobian[::-1].transpose(1, 0, 2).reshape(count, -1)
    flow = np.empty((last + 1, count, count))
    flow[0] = np.eye(count)
    for k in range(last):
        used = reversed_rows[:, (last - k) * count :]
        flow[k + 1] = used @ flow[: k + 1].reshape(-1, count) / (k + 1)
    sizes, slopes = np.abs(flow), np.abs(jacobian)
    # Σ_{i ≥ m} |J_i| for m = last, …, 0, which multiply |M_0|, …, |M_last|.
    tails = np.cumsum(slopes[::-1], axis=0)
    defect = np.einsum("kab,kbc->ac", tails, sizes)
    defect += (rest + SUM_ROUNDING * tails[-1]) @ sizes.sum(axis=0)
    error = phi @ (ROUND_UP * defect) + SUM_ROUNDING * sizes.sum(axis=0)
    return flow, ROUND_UP * error
