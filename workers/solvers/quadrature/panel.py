r"""One panel of a time map: dt/du as a series, with a proven bound of its truncation.

On the panel |x| ≤ 1 the rate is f > 0 and its inverse square F = 1/f² (:mod:`.squared_speed`) is
holomorphic inside the ellipse of Bernstein of the parameter ρ, with |F| ≤ M there. Which ellipse, and for
which degree of interpolation, is found by trials: the higher the degree, the closer to the panel the ellipse
may be, and the more nodes it takes. The series is the polynomial p = Σ p_k T_k that takes the values of f
at PANEL_DEGREE + 1 Chebyshev points, and Π = Σ |p_k| ρ^k bounds it on the ellipse. So

.. math:: E = p^2 F - 1,\qquad |E| \le \Pi^2 M + 1 \quad\text{on the ellipse.}

A function bounded by B there has Chebyshev coefficients of at most 2 B ρ^-k. The polynomial of degree n
through its values at the n + 1 points cos(πj/n) takes those of degree k > n for others, hence differs from
it on the panel by at most

.. math:: \tau_n(B) = \sum_{k>n} 2\cdot 2B\rho^{-k} = \frac{4B\rho^{-n}}{\rho-1}

(Trefethen, Approximation Theory and Approximation Practice, theorems 8.1 and 8.2), and is itself at most
Λ times its largest value at the points, Λ = 1 + (2/π) log(n + 1) (theorem 15.2). E is known at the points,
in balls:

.. math:: |E| \le e = \Lambda\max_j|E_j| + \tau_n(\Pi^2 M + 1) .

If e ≤ 1/4, then p² F > 0: F has no zero on the panel, which proves the motion to pass it, and p, positive
at the points, has none. So p = f √(1 + E), and with S = Σ |p_k| and \|(1 + E)^{-1/2} − 1 + E/2\| ≤ E²

.. math:: |p - f| \le e f,\qquad
          \Bigl|\int_{-1}^1 f\,dx - \int_{-1}^1 p\,dx + \frac12\sum_j w_j\,p(x_j) E_j\Bigr|
          \le \tau_n(\Pi(\Pi^2 M + 1)) + 2 S e^2 ,

w_j being the weights of Clenshaw and Curtis, whose sum is exact for what goes through the points. The error
of the series is corrected by what is known of it: lengths are as good as the bound of F, which may be entire
where f has singularities. The series that is kept has the coefficients p_k rounded to doubles as p_k + δ_k,
which moves its integral from −1 to any x by at most

.. math:: \sum_k |\delta_k| \max_x\Bigl|\int_{-1}^x T_k\,dx\Bigr| \le
          2|\delta_0| + \frac12|\delta_1| + \sum_{k\ge 2}\frac{2k}{k^2-1}|\delta_k| .
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf, isfinite, log, nextafter, pi, sqrt
from typing import NamedTuple, Protocol

import numpy as np
from flint import acb, arb, arb_mat, ctx
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import EPSILON, chebyshev_coefficients
from workers.solvers.errors import PrecisionLostError, QuadratureNotConvergedError

FloatArray = NDArray[np.float64]
PANEL_DEGREE = 32
"""Degree of the series of a panel."""
WANTED_RELATIVE_TAIL = 2e-19
"""Tail of F against F in the middle of the panel, by which an ellipse is chosen."""
REGION_RELATIVE_SIZE = 1.0 + 2.0**-20
"""Rectangles are so much larger than needed: the rounding of their corners is inside."""
KNOWN_BITS = 60
LARGEST_DEPARTURE = 0.25
"""Limit that e must stay below."""
SERIES_ROUNDING = 64.0 * EPSILON
"""More than those of PANEL_DEGREE coefficients of a series that is nearly constant, in parts of it."""


class PhaseSpeed(Protocol):
    """Bounds of (dθ/dt)², and its limits."""

    def bound(self, chain: Sequence[acb], *, is_close: bool) -> arb:
        """Return an upper bound of its absolute value on rectangles, each touching the one to its left.

        Not finite unless it is proved to be holomorphic there. ``is_close``: dearer and closer.
        """
        ...

    def enclosed(self, theta: arb) -> arb:
        """Return an enclosure of (dθ/dt)² on a stretch of real phases, smooth there or not."""
        ...

    def limit(self, theta: arb) -> arb | None:
        """Return dt/dθ at a turning point, a pole or the equator; not finite if unknown, None elsewhere."""
        ...


@dataclass(frozen=True, slots=True)
class BranchedSpeed:
    """Bounds that are those of other formulas on other stretches of u = θ/π."""

    parts: tuple[tuple[float, float, PhaseSpeed], ...]
    """Where each stretch begins and ends, in order, and the bounds on it."""
    kinks: tuple[tuple[float, float], ...]
    """The stretches that hold kinks, which are narrow."""

    @property
    def edges(self) -> tuple[float, ...]:
        """Return the u at which one function ends and another begins."""
        return (*(left for left, _, _ in self.parts), self.parts[-1][1])

    def on(self, left: float, right: float) -> PhaseSpeed:
        """Return the bounds for a stretch of u between two edges."""
        return next(speed for begin, end, speed in self.parts if begin <= left and right <= end)


class _Trial(NamedTuple):
    """A way to bound the tail of F."""

    degree: int
    """n, a multiple of PANEL_DEGREE."""
    rho: float
    parts: int
    """Rectangles that cover the ellipse."""
    is_close: bool


TRIALS = (
    _Trial(64, 2.6, 1, False),
    _Trial(64, 2.4, 4, False),
    _Trial(96, 1.85, 4, False),
    _Trial(64, 2.4, 2, True),
    _Trial(96, 1.8, 8, False),
    _Trial(128, 1.6, 16, False),
)
"""In the order of their cost."""
FLAT = _Trial(128, 1.0 + 2.0**-20, 4, False)
"""Hardly more than the panel."""


@dataclass(frozen=True, slots=True)
class Ellipse:
    """An ellipse about a panel on which F is proved to be holomorphic, in units of u = θ/π."""

    degree: int
    """Degree of the interpolation that this ellipse is for."""
    rho: float
    largest: arb
    """M."""


def find_ellipse(speed: PhaseSpeed, left: float, right: float, middle_rate: arb) -> Ellipse | None:
    """Return an ellipse on which F is bounded well enough, or None; f is ``middle_rate`` in the middle."""
    size = 1 / (middle_rate * middle_rate)
    for trial in TRIALS:
        largest = speed.bound(_chain(left, right, trial), is_close=trial.is_close) / arb.pi() ** 2
        is_doubtful = trial is TRIALS[1] and not largest.is_finite()
        if is_doubtful and not speed.bound(_chain(left, right, FLAT), is_close=False).is_finite():
            # With a kink on the panel itself nothing else is worth its cost.
            return None
        if tail_of(trial.degree, trial.rho, largest) < WANTED_RELATIVE_TAIL * size:
            return Ellipse(trial.degree, trial.rho, largest.upper())
    return None


def tail_of(degree: int, rho: float, largest: arb) -> arb:
    """Return τ."""
    return 4 * largest / (arb(rho) ** degree * (arb(rho) - 1))


def _chain(left: float, right: float, trial: _Trial) -> list[acb]:
    """Return rectangles in θ = πu that cover the ellipse about the panel."""
    middle, half = (arb(left) + arb(right)) / 2, (arb(right) - arb(left)) / 2
    across, along = (trial.rho + 1.0 / trial.rho) / 2.0, (trial.rho - 1.0 / trial.rho) / 2.0
    width = across / trial.parts
    chain = []
    for k in range(trial.parts):
        place = (2 * k + 1 - trial.parts) * width
        nearest = max(0.0, abs(place) - width) / across
        x = arb.pi() * (middle + half * arb(place, width * REGION_RELATIVE_SIZE))
        y = arb(0, (arb.pi() * half * (along * sqrt(1.0 - nearest * nearest) * REGION_RELATIVE_SIZE)).upper())
        chain.append(acb(x, y))
    return chain


@dataclass(frozen=True, slots=True)
class Panel:
    """dt/du for left ≤ u ≤ right."""

    left: float
    right: float
    series: FloatArray
    """Chebyshev coefficients, shape (PANEL_DEGREE + 1,)."""
    length: arb
    """The time it takes."""
    error: float
    """Bound of the error of the length; inf if none is proved."""
    inner_error: float
    """Bound of the error of the integral of the series from −1 to any place; inf if none is proved."""
    change: float
    """Relative change of the length from half the nodes."""
    nodes: int
    """Evaluations of the rate."""

    def between(self, slowest: arb, fastest: arb) -> "Panel":
        """Return the panel with the proof that f lies between two bounds: its weights are positive.

        The series departs from the middle of them by at most Λ < 4 halves of their distance.
        """
        width = above((fastest - slowest) * (arb(self.right) - arb(self.left)))
        return replace(self, error=width, inner_error=3.0 * width + SERIES_ROUNDING * float(self.length))

    @property
    def tail(self) -> float:
        """The sum of the absolute values of the last two coefficients, times the length of the panel."""
        return float(np.abs(self.series[-2:]).sum()) * (self.right - self.left)

    @property
    def relative_tail(self) -> float:
        """The larger of the last two coefficients in parts of the largest."""
        return float(np.abs(self.series[-2:]).max()) / float(np.abs(self.series).max())


def make_panel(
    rate: Callable[[arb], arb],
    left: float,
    right: float,
    ellipse: Ellipse | None,
    limit: Callable[[arb], arb | None] = lambda _: None,
) -> Panel:
    """Return the panel of dt/dθ = ``rate``, with its proof if there is an ellipse.

    At turning points, at poles and on the equator a rate is taken a hair beside them: at its ends, the only
    nodes that may be such, the panel has the ``limit`` instead where that is known.

    Raises
    ------
    PrecisionLostError
        The rate is known to fewer than KNOWN_BITS.
    QuadratureNotConvergedError
        The rate is beyond all doubles.
    """
    degree = PANEL_DEGREE if ellipse is None else ellipse.degree
    values = _values(rate, limit, left, right, degree)
    doubles = np.array([float(value) for value in values[:: degree // PANEL_DEGREE]])
    # Rates of a motion that is as quick are 0 in doubles.
    if not (np.isfinite(doubles).all() and doubles.any()):
        raise QuadratureNotConvergedError("the time of a part of the way is beyond all doubles")
    series = chebyshev_coefficients(doubles)
    half = (arb(right) - arb(left)) / 2
    fine, coarse = (
        _sum(_rule(PANEL_DEGREE // k, ctx.prec).weights, values[:: k * degree // PANEL_DEGREE])
        for k in (1, 2)
    )
    change = abs(float((fine - coarse) / fine))
    if ellipse is None:
        return Panel(left, right, series, (half * fine).mid(), inf, inf, change, len(values))
    length, error, inner_error = _proved(series, values, ellipse)
    errors = above(half * error), above(half * inner_error)
    return Panel(left, right, series, (half * length).mid(), *errors, change, len(values))


def _proved(series: FloatArray, values: Sequence[arb], ellipse: Ellipse) -> tuple[arb, arb, arb]:
    """Return ∫ f dx, the bound of its error, and that of ∫ f dx from −1 to any place by the ``series``."""
    degree, rho = ellipse.degree, arb(ellipse.rho)
    base, rule = _rule(PANEL_DEGREE, ctx.prec), _rule(degree, ctx.prec)
    known = arb_mat([[value] for value in values[:: degree // PANEL_DEGREE]])
    coefficients = base.interpolation * known
    p = (rule.series * coefficients).entries()
    sizes, S, Pi = coefficients.entries(), arb(0), arb(0)
    rounding = arb(0)
    # Horner's rule for Π.
    for k in range(PANEL_DEGREE, -1, -1):
        size = abs(sizes[k])
        S, Pi = S + size, Pi * rho + size
        rounding += abs(sizes[k] - arb(series[k])) * base.rises[k]
    E = [at * at / (value * value) - 1 for at, value in zip(p, values, strict=True)]
    B = Pi * Pi * ellipse.largest + 1
    Lambda = 1.0001 + 2.0 / pi * log(degree + 1)
    e = Lambda * arb(max(abs(value).upper() for value in E)) + tail_of(degree, ellipse.rho, B)
    integral = _sum(base.weights, values[:: degree // PANEL_DEGREE])
    if not (e < LARGEST_DEPARTURE and all(at > 0 for at in p)):
        # Where E is not small it corrects nothing: the sum, whose weights are positive, is at least a time.
        return integral, arb("inf"), arb("inf")
    length = integral - _sum(rule.weights, [at * value for at, value in zip(p, E, strict=True)]) / 2
    error = length.rad() + tail_of(degree, ellipse.rho, Pi * B) + 2 * S * e * e
    # |p − f| ≤ e f, and the integral of f over the panel is positive.
    return length, error, e * (length.abs_upper() + error) + rounding


def above(value: arb) -> float:
    """Return a double that is no less than the ball; inf if it is not finite."""
    found = float(value.upper())
    return nextafter(found, inf) if isfinite(found) else inf


@dataclass(frozen=True, slots=True)
class _Rule:
    """At the points cos(πj/degree)."""

    points: tuple[arb, ...]
    weights: tuple[arb, ...]
    """Weights of Clenshaw and Curtis (1960)."""
    series: arb_mat
    """T_k at the points, k ≤ PANEL_DEGREE."""
    interpolation: arb_mat
    """Chebyshev coefficients from values at the points."""
    rises: tuple[arb, ...]
    """Bounds of the integral of T_k from −1 to any place, k ≤ PANEL_DEGREE."""


@lru_cache(maxsize=32)
def _rule(degree: int, precision: int) -> _Rule:
    with ctx.workprec(precision):
        cosines = [(arb.pi() * k / degree).cos() for k in range(2 * degree)]
        table = [[cosines[j * k % (2 * degree)] for k in range(PANEL_DEGREE + 1)] for j in range(degree + 1)]
        halves = [(1 if k in (0, degree) else 2) for k in range(degree + 1)]
        inverse = [
            [cosines[j * k % (2 * degree)] * halves[j] * halves[k] / (2 * degree) for j in range(degree + 1)]
            for k in range(degree + 1 if degree == PANEL_DEGREE else 0)
        ]
        rises = (arb(2), arb(0.5), *(arb(2 * k) / (k * k - 1) for k in range(2, PANEL_DEGREE + 1)))
        points, weights = tuple(cosines[: degree + 1]), _weights(degree, cosines)
        return _Rule(points, weights, arb_mat(table), arb_mat(inverse), rises)


def _weights(degree: int, cosines: Sequence[arb]) -> tuple[arb, ...]:
    weights = []
    for j in range(degree + 1):
        total = arb(1)
        for k in range(1, degree // 2 + 1):
            factor = 1 if 2 * k == degree else 2
            total -= factor * cosines[2 * k * j % (2 * degree)] / (4 * k * k - 1)
        weights.append(total * (1 if j in (0, degree) else 2) / degree)
    return tuple(weights)


def _values(
    rate: Callable[[arb], arb], limit: Callable[[arb], arb | None], left: float, right: float, degree: int
) -> list[arb]:
    middle, half = (arb(left) + arb(right)) / 2, (arb(right) - arb(left)) / 2
    phases = [arb.pi() * (middle + half * x) for x in _rule(degree, ctx.prec).points]
    known = {k: limit(phases[k]) for k in (0, degree)}
    values = []
    for k, theta in enumerate(phases):
        value = known.get(k)
        values.append(arb.pi() * (value if value is not None and value.is_finite() else rate(theta)))
    if min(value.rel_accuracy_bits() for value in values) < KNOWN_BITS:
        raise PrecisionLostError(f"the integrand is known to fewer than {KNOWN_BITS} bits")
    return values


def _sum(weights: Sequence[arb], values: Sequence[arb]) -> arb:
    total = arb(0)
    for weight, value in zip(weights, values, strict=True):
        total += weight * value
    return total
