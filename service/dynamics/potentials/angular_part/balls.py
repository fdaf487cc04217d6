r"""Encloses the angular part V1[F] in balls: by integrals over F, or by series if F is a sum of powers of w.

Integrals over F are enclosed piece by piece, cut at the kinks of F(w), which are zeros of absolute values.
An integrator that is left alone with a kink halves its way to it, at several times the price.

The potential of w^m that vanishes like |g3|^(2αm+2) at g3 = 0 is homogeneous, and its second factor solves
the equation of Gauss (H. M. Yehia's (e1) and (eg)): with ζ = (g3/g1)²

.. math:: \frac{\alpha+\zeta}{1+\zeta}\int_0^\zeta \frac{z^{\alpha m}(1+z)^{(1-\alpha)m}}{(\alpha+z)^2}\,dz
          = \frac{\zeta^{\alpha m+1}}{\alpha(\alpha m+1)}\,(1+\zeta)^{(1-\alpha)m}\;
            {}_2F_1(2, m+1; \alpha m+2; -\zeta),

and both sides are continued to all m but those with αm + 1 = 0, −1, −2, …, which are left to the integral.
Between two directions the difference of the integrals is that of V1.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import TypeVar

from flint import acb, arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.ball import BallAlgebra, ComplexBallAlgebra, ball
from service.dynamics.formula.algebras.jets import FirstOrderJets, SecondOrderJets
from service.dynamics.formula.algebras.power_sums import ONE, PowerAlgebra, PowerSum, Small
from service.dynamics.formula.algebras.real import FloatArray, RealAlgebra
from service.dynamics.formula.rewriting import copied, with_signs
from service.dynamics.formula.tape import Tape

T = TypeVar("T")
_Algebras = tuple[Algebra[T], FirstOrderJets[T], SecondOrderJets[T]]


@dataclass(frozen=True, slots=True)
class CurveFunction:
    """F(w) by a tape over the one variable w; each method returns (F, θF, θ²F) up to ``order`` ≤ 2."""

    tape: Tape

    def real(self, w: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Return doubles; the parts may have fewer axes than ``w`` where they are constant."""
        return self._powers(_REAL, w, order)

    def ball(self, w: arb, order: int) -> tuple[arb, ...]:
        """Return enclosures, NaN where F is undefined."""
        return self._powers(_BALL, w, order)

    def complex_ball(self, w: acb, order: int, *, analytic: bool) -> tuple[acb, ...]:
        """Return enclosures of the continuation to complex w; see ComplexBallAlgebra for ``analytic``."""
        return self._powers(_COMPLEX[analytic], w, order)

    def _powers(self, algebras: _Algebras[T], w: T, order: int) -> tuple[T, ...]:
        base, first, second = algebras
        if order == 0:
            return (self.tape.evaluate(base, (w,)),)
        if order == 1:
            jet = self.tape.evaluate(first, first.variables((w,)))
            return jet.value, base.multiply(w, first.gradient(jet)[0])
        jet = self.tape.evaluate(second, second.variables((w,)))
        slope, curvature = second.gradient(jet)[0], second.hessian(jet)[0][0]
        # θ²F = w (F' + w F'').
        bent = base.add(slope, base.multiply(w, curvature))
        return jet.value, base.multiply(w, slope), base.multiply(w, bent)


def _with_jets(base: Algebra[T]) -> _Algebras[T]:
    return base, FirstOrderJets(base, 1), SecondOrderJets(base, 1)


_REAL = _with_jets(RealAlgebra())
_BALL = _with_jets(BallAlgebra())
_COMPLEX = {analytic: _with_jets(ComplexBallAlgebra(analytic=analytic)) for analytic in (False, True)}
GENERIC_W = Fraction(2, 3)
"""A value of w at which the formula is followed."""


def powers_of(tape: Tape, alpha: Fraction) -> Mapping[Fraction, arb] | None:
    """Return the coefficients of F by the exponents of w, at the current precision.

    None if F is no sum of powers, or has one at which V1 has another form.
    """
    return _powers_at(tape, alpha, ctx.prec)


@lru_cache(maxsize=64)
def _powers_at(tape: Tape, alpha: Fraction, bits: int) -> Mapping[Fraction, arb] | None:
    with ctx.workprec(bits):
        base = BallAlgebra()
        algebra = PowerAlgebra(base, Small(base.constant(GENERIC_W), 1, 1))
        found = tape.evaluate(algebra, (PowerSum({(Fraction(1), 0): Fraction(1)}),))
        terms = {power[0]: algebra.value(PowerSum({ONE: factor})) for power, factor in found.terms.items()}
    if algebra.powers or not all(value.is_finite() for value in terms.values()):
        # A function of w that is no power has been asked for its value.
        return None
    is_other = ((alpha * m + 1).denominator == 1 and alpha * m + 1 <= 0 for m in terms)
    return None if any(is_other) else terms


def angular_of_power(m: Fraction, alpha: Fraction, scale: arb, start: arb, zeta: arb) -> arb:
    """Return V1[w^m] at the direction ``zeta``, 0 at ``start``; ``scale`` is (|A − C| ρ)^(α−1)."""
    a, power = ball(alpha), ball(m)
    turned = (a + zeta) / (1 + zeta) * (1 + start) / (a + start)
    difference = _from_axis(power, a, zeta) - turned * _at_start(m, alpha, _Exact(start), ctx.prec)
    return (1 - a) * (power * scale.log()).exp() * difference


class _Exact:
    """A ball that is known by its bits."""

    def __init__(self, ball: arb) -> None:
        self.ball = ball
        self._bits = ball.mid().man_exp(), ball.rad().man_exp()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Exact) and self._bits == other._bits

    def __hash__(self) -> int:
        return hash(self._bits)


@lru_cache(maxsize=64)
def _at_start(m: Fraction, alpha: Fraction, start: _Exact, bits: int) -> arb:
    """Return the right-hand side above at the direction at which V1 vanishes."""
    with ctx.workprec(bits):
        return _from_axis(ball(m), ball(alpha), start.ball)


def _from_axis(m: arb, alpha: arb, zeta: arb) -> arb:
    """Return the right-hand side above."""
    e = alpha * m + 1
    size = (e * zeta.log() + (1 - alpha) * m * zeta.log1p()).exp() / (alpha * e)
    return size * (-zeta).hypgeom_2f1(arb(2), m + 1, e + 1)


MAX_LOG_W = 64
"""Kinks are looked for at |log w| up to this; beyond them F is left as it is."""
MAX_KINKS = 16
MAX_STRETCHES = 2000


@dataclass(frozen=True, slots=True)
class CurvePiece:
    """F by a tape that has no kink where lower ≤ log w ≤ upper, or a kink that is between them."""

    lower: arb
    upper: arb
    tape: Tape
    has_kink: bool


def curve_pieces(tape: Tape) -> tuple[CurvePiece, ...]:
    """Return pieces that cover |log w| ≤ MAX_LOG_W, at the current precision; none if F has no kinks."""
    return _pieces_at(tape, ctx.prec)


@lru_cache(maxsize=64)
def _pieces_at(tape: Tape, bits: int) -> tuple[CurvePiece, ...]:
    arguments = dict.fromkeys(
        made.left for made in tape.instructions if made.operation == "call" and made.name == "abs"
    )
    if not arguments:
        return ()
    builder, registers = copied(tape)
    tapes = {argument: builder.tape(registers[argument]) for argument in arguments}
    with ctx.workprec(bits + 16):
        found = _stretches(list(tapes.values()), bits)
    if found is None or not any(0 in signs for *_, signs in found):
        return ()
    return tuple(
        CurvePiece(
            lower,
            upper,
            with_signs(tape, {a: s for a, s in zip(tapes, signs, strict=True) if s}),
            has_kink=0 in signs,
        )
        for lower, upper, signs in _joined(found)
    )


Stretch = tuple[arb, arb, tuple[int, ...]]


def _stretches(arguments: Sequence[Tape], bits: int) -> list[Stretch] | None:
    """Return stretches of log w in order, with the signs of the arguments, 0 at kinks; None if too many."""
    shortest = arb(2) ** -bits
    pending = [(arb(k), arb(k + 1)) for k in reversed(range(-MAX_LOG_W, MAX_LOG_W))]
    done: list[Stretch] = []
    for _ in range(MAX_STRETCHES):
        if not pending:
            return done if sum(0 in signs for *_, signs in done) <= 2 * MAX_KINKS else None
        lower, upper = pending.pop()
        w = lower.union(upper).exp()
        signs = tuple(_sign(argument, w) for argument in arguments)
        if 0 not in signs or upper - lower < shortest:
            done.append((lower, upper, signs))
        else:
            middle = ((lower + upper) / 2).mid()
            pending += [(middle, upper), (lower, middle)]
    return None


def _sign(argument: Tape, w: arb) -> int:
    value = argument.evaluate(BallAlgebra(), (w,))
    return 1 if value > 0 else -1 if value < 0 else 0


def _joined(stretches: Sequence[Stretch]) -> Iterator[Stretch]:
    """Yield the stretches with neighbours of the same signs made one."""
    lower, upper, signs = stretches[0]
    for low, high, here in stretches[1:]:
        if here == signs:
            upper = high
        else:
            yield lower, upper, signs
            lower, upper, signs = low, high, here
    yield lower, upper, signs


EVALUATIONS_PER_BIT = 200
"""Limit of the integrator. Smooth functions need some 10; what is not reached is honestly wide."""
NEWTON_STEPS = 10
"""The slope is monotonic and between 1 and α: more than enough, and what is left enters the bounds."""


def angular_balls(
    body: RigidBody, function: CurveFunction, order: int, g1: arb, g3: arb, reference_angle: arb
) -> tuple[arb, ...]:
    """Return enclosures of V1[θ^k F] for k = 0..``order``, at the current ``flint.ctx.prec``.

    NaN where the balls of g1 or g3 contain zero, and where F is undefined
    anywhere between the reference direction and the point.
    """
    alpha = ball(body.alpha)
    squares = g1 * g1, g3 * g3
    zeta, rho = squares[1] / squares[0], squares[0] + squares[1]
    if not (zeta.is_finite() and zeta > 0):
        return (arb("nan"),) * (order + 1)
    scale = ((ball(abs(body.A - body.C)) * rho).log() * (alpha - 1)).exp()
    T = (alpha * squares[0] + squares[1]) / rho
    start = reference_angle.tan() ** 2
    powers = powers_of(function.tape, body.alpha)
    if powers is not None:
        parts = {m: angular_of_power(m, body.alpha, scale, start, zeta) for m in powers}
        # θ multiplies w^m by m.
        return tuple(
            sum((powers[m] * ball(m**k) * part for m, part in parts.items()), arb(0))
            for k in range(order + 1)
        )
    paths = [_Path(function, k, alpha, 1 - alpha, scale, start, zeta) for k in range(order + 1)]
    at_point = function.ball(curve_ball(body, g1, g3), order)
    at_start = [path.real(start.log()) for path in paths]
    if not all(value.is_finite() for value in (*at_point, *at_start)):
        return (arb("nan"),) * (order + 1)
    # V1 needs the accuracy of F, to which it is added; θF may be zero.
    size = sum((abs(value) for value in (*at_point, *at_start)), start=arb(0))
    size = size if size > 0 else arb(1)
    return tuple((1 - alpha) * T * _integral(path, size) for path in paths)


def curve_ball(body: RigidBody, g1: arb, g3: arb) -> arb:
    """Return the enclosure of w, NaN where the ball of g1 or g3 contains zero."""
    alpha = ball(body.alpha)
    return (
        (alpha - 1) * ball(abs(body.A - body.C)).log() + 2 * (alpha * abs(g3).log() - abs(g1).log())
    ).exp()


@dataclass(slots=True)
class _Path:
    """∫ θ^k F(w) dz / (α + z)² over log z, from z = ``start`` to z = ``end``."""

    function: CurveFunction
    k: int
    alpha: arb
    exponent: arb
    """1 − α."""
    scale: arb
    """(|A − C| ρ)^(α−1)."""
    start: arb
    end: arb
    is_undefined: bool = False
    """F has no real value at a point of the integration."""

    def log_w(self, y: arb) -> arb:
        """Return log w; its slope is between 1 and α."""
        return self.scale.log() + self.alpha * y + self.exponent * y.exp().log1p()

    def places(self, log_w: arb) -> tuple[arb, arb]:
        """Return exact numbers just below and just above all y with this log w, wherever in its ball ρ is."""
        y, least = arb(0), min(arb(1), self.alpha)
        for _ in range(NEWTON_STEPS):
            share = y.exp() / (1 + y.exp())
            y = (y - (self.log_w(y) - log_w) / (self.alpha + self.exponent * share)).mid()
        apart = (abs(self.log_w(y) - log_w) / least).abs_upper() * 2
        return (y - apart).mid(), (y + apart).mid()

    def real(self, y: arb) -> arb:
        """Return the integrand over y = log z; NaN where F is undefined as a real function."""
        alpha, exponent = self.alpha, self.exponent
        # On either side the form whose terms vary little on a wide ball of y.
        if y > 0:
            t = (-y).exp()
            shape, weight = y + exponent * t.log1p(), t / (1 + alpha * t) ** 2
        else:
            t = y.exp()
            shape, weight = alpha * y + exponent * t.log1p(), t / (alpha + t) ** 2
        return self.function.ball(self.scale * shape.exp(), self.k)[self.k] * weight

    def __call__(self, y: acb, analytic: bool) -> acb:
        """Return the integrand for ``acb.integral``."""
        if self.is_undefined:
            return acb(0)  # so that the integrator comes to its end at once
        if not analytic and y.imag.is_zero():
            value = self.real(y.real)
            self.is_undefined = not value.is_finite() and not self.real(y.real.mid()).is_finite()
            return acb(value)
        alpha, exponent = self.alpha, self.exponent
        if y.real > 0:
            t = (-y).exp()
            shape, weight = y + exponent * (1 + t).log(analytic), t / (1 + alpha * t) ** 2
        else:
            t = y.exp()
            shape, weight = alpha * y + exponent * (1 + t).log(analytic), t / (alpha + t) ** 2
        w = self.scale * shape.exp()
        return self.function.complex_ball(w, self.k, analytic=analytic)[self.k] * weight


def _integral(path: _Path, size: arb) -> arb:
    """Return the enclosure of the integral: between the midpoints of its ends, and what the ends add.

    Its error is small against ``size``, or against the integral if that is larger.
    """
    start, end = path.start.log(), path.end.log()
    at_start, at_end = path.real(start), path.real(end)
    accuracy = max(8, min(ctx.prec, path.end.rel_accuracy_bits() + 8))
    tolerance = arb(2) ** -accuracy
    integral = arb(0)
    for piece, low, high in _split(path, start.mid(), end.mid()):
        if piece is None:
            # About a kink: the stretch is as short as the precision.
            integral += path.real(low.union(high)) * (high - low)
            continue
        part = acb.integral(
            piece,
            acb(low),
            acb(high),
            rel_tol=tolerance,
            abs_tol=(tolerance * size).mid(),
            eval_limit=EVALUATIONS_PER_BIT * ctx.prec,
        )
        path.is_undefined = path.is_undefined or piece.is_undefined
        integral += part.real
    integral = integral if start.mid() < end.mid() else -integral
    if path.is_undefined:
        return arb("nan")
    return integral + at_end * (end - end.mid()) - at_start * (start - start.mid())


def _split(path: _Path, start: arb, end: arb) -> Iterator[tuple[_Path | None, arb, arb]]:
    """Yield stretches low ≤ y ≤ high of the way between exact ends, with F on them; None about a kink."""
    first, last = (start, end) if start < end else (end, start)
    pieces = curve_pieces(path.function.tape)
    if not pieces or not (path.log_w(first) > pieces[0].lower and path.log_w(last) < pieces[-1].upper):
        yield path, first, last
        return
    here = first
    for piece in pieces:
        if piece.upper < path.log_w(first) or piece.lower > path.log_w(last):
            continue
        below, above = path.places(piece.upper)
        below = max(below, here)
        is_last = not below < last
        stop = last if is_last else below
        own = None if piece.has_kink else replace(path, function=CurveFunction(piece.tape))
        yield own, here, stop
        if is_last:
            return
        here = min(max(above, stop), last)
        yield None, stop, here
    yield None, here, last
