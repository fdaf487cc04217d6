r"""Bodies with A = 2C and rational potentials: exact windows, root gaps and the period in balls.

In x = |g1| the curve is g3² = ν x, and V's terms |g1|^i |g3|^j give, exactly,

.. math:: p^2 = P(x) = \frac{1}{2C}\sum V_{ij}\,\nu^{j/2}\,(j\,x - i\nu)\,x^{i+j/2-1},
          \qquad \dot x^2 = \frac{4x}{\nu}\,(x_1-x)(x-x_2)\,P(x),

x1 being the equator, x2 = −1/x1. The distances between its zeros are rounded to
doubles after they are formed, so next to a separatrix they keep all their digits.
With L1 > 0 and L2 > 0 linear and vanishing at the zeros next to lo ≤ x ≤ hi,
x = lo cos²φ + hi sin²φ, tan φ = √(L1(lo)/L1(hi)) tan χ and χ an amplitude of the
uniform ψ (:mod:`workers.solvers.closed_form`), the period of x is

.. math:: T = \frac{2\pi}{M}\,\Bigl\langle \sqrt{L_1 L_2/k}\Bigr\rangle_\psi,
          \quad k = \dot x^2/((x-lo)(hi-x)),

M the arithmetic-geometric mean of √(L1(lo) L2(hi)) and √(L1(hi) L2(lo)). The
integrand is analytic and even: its mean over equidistant ψ converges geometrically,
with a number of nodes that grows like the logarithm of 1/gap.
"""

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import cast

from flint import acb, arb, ctx, fmpq, fmpq_poly, fmpz_poly

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.algebras.monomials import added_up, as_fmpq, without_zeros
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.potentials.recognition import Laurent, laurent
from service.dynamics.problem import PlanarMotion, StartAtPoint
from service.dynamics.solution.dense_output import EPSILON, Period
from workers.solvers.compiled.frame import Frame
from workers.solvers.compiled.records import ARC, Loop, Records, Start, new_records
from workers.solvers.compiled.windows.arcs import REST, choose_start
from workers.solvers.three_terms import RootsUndecidedError, positive_stretches

PRECISIONS = (192, 512, 2048)
GAP_BITS = 64
MAX_NODES = 1024
SETTLED_CHANGE = 1e-26
"""Relative change of the mean by a doubling that is left to the claim: 1e-18 after 1e8 periods."""
MAX_ROOTS = 16


@dataclass(frozen=True, slots=True)
class Radicand:
    """P = x^−μ · polynomial in x = |g1|, with the curve's ν."""

    polynomial: fmpq_poly
    power: int
    """μ, an integer of any sign; the polynomial does not vanish at 0."""
    nu: Fraction
    C: Fraction


@dataclass(frozen=True, slots=True)
class Stretch:
    """lo ≤ x ≤ hi with P > 0 inside, and the zeros of P elsewhere."""

    radicand: Radicand
    lo: arb
    hi: arb
    x1: arb
    low_is_root: bool
    high_is_root: bool
    passes_pole: bool
    """lo = 0, and P is finite there."""
    reals: tuple[arb, ...]
    """Real zeros of P that are no ends."""
    pairs: tuple[tuple[arb, arb], ...]
    """Real and imaginary parts of the others, one of each pair."""

    @property
    def is_periodic(self) -> bool:
        """Say whether both ends are turned at or passed."""
        return self.low_is_root or self.passes_pole


def rational_radicand(body: RigidBody, potential: Potential, motion: PlanarMotion) -> Radicand | None:
    """Return P if A = 2C (or C = 2A) and V is rational and even in g2 and g3 on the curve, else None."""
    nu = curve_of(body, motion)
    expanded = None if nu is None else expansion_of(body, potential, motion)
    return None if nu is None or expanded is None else radicand_of(body, expanded, nu)


def curve_of(body: RigidBody, motion: PlanarMotion) -> Fraction | None:
    """Return ν of the curve g3² = ν |g1|, in axes in which A = 2C; None if it is no such curve."""
    if body.A == 2 * body.C:
        return motion.lambda_squared
    # λ' = λ^(−A/C) = λ^(−1/2) is squared.
    return None if body.C != 2 * body.A or motion.lambda_ is None else 1 / motion.lambda_


def expansion_of(body: RigidBody, potential: Potential, motion: PlanarMotion) -> Laurent | None:
    """Return V in the axes of :func:`curve_of`, on the side that ``motion`` is on; None if not rational."""
    if not isinstance(potential, FormulaPotential):
        return None
    is_exchanged = body.A != 2 * body.C
    return laurent(
        potential.tape, motion.g3_sign if is_exchanged else motion.sign_of_g1, is_exchanged=is_exchanged
    )


def radicand_of(body: RigidBody, expanded: Laurent, nu: Fraction) -> Radicand | None:
    """Return P on the curve of ν, None if V is not even in g2 and g3 or has too many powers."""
    if any(k or e or j % 2 for _, j, k, e in expanded):
        return None
    C = min(body.A, body.C)
    parts = list[tuple[int, fmpq]]()
    exact_nu, unit = as_fmpq(nu), as_fmpq(1 / (2 * C))
    for (i, j, _, _), value in expanded.items():
        weight = value * unit * exact_nu ** (j // 2)
        at = i + j // 2
        parts += [(at, weight * j), (at - 1, -weight * i * exact_nu)]
    terms = without_zeros(added_up(parts))
    if not terms or max(terms) - min(terms) > MAX_ROOTS:
        return None
    lowest = min(terms)
    dense = [terms.get(lowest + k, fmpq(0)) for k in range(max(terms) - lowest + 1)]
    return Radicand(fmpq_poly(dense), -lowest, nu, C)


def find_stretch(radicand: Radicand, window: int | None) -> Stretch | None:
    """Return the stretch that is asked for (the only one for None), None if it is not there.

    Raises
    ------
    RootsUndecidedError
        Zeros are multiple, or cannot be told from an end.
    """
    nu = ball(radicand.nu)
    x1 = 2 / (nu + (nu * nu + 4).sqrt())
    reals, pairs = _zeros(radicand)
    found = [
        Stretch(
            radicand,
            at.lo,
            at.hi,
            x1,
            at.low_is_root,
            at.high_is_root,
            not at.low_is_root and radicand.power == 0,
            # The very balls are the ends: equal ones would not compare as equal.
            tuple(root for root in reals if root is not at.lo and root is not at.hi),
            pairs,
        )
        for at in positive_stretches(reals, x1, lambda x: _value(radicand, x))
    ]
    if window is None:
        return found[0] if len(found) == 1 else None
    return found[window] if 0 <= window < len(found) else None


def period_of_x(stretch: Stretch) -> Period | None:
    """Return the time from lo to hi and back, None if MAX_NODES do not resolve it.

    The error claimed is the last change, by doubling the equidistant ψ; convergence being geometric,
    what is left is about its square.
    """
    integrand = _Integrand(stretch)
    count, total = 4, sum(integrand.at_ends(), arb(0)) / 2
    half_pi = arb.pi() / 2
    for j in range(1, count):
        total += integrand(half_pi * j / count)
    mean = total / count
    while count < MAX_NODES:
        for j in range(count):
            total += integrand(half_pi * (2 * j + 1) / (2 * count))
        count *= 2
        previous, mean = mean, total / count
        change = abs(float((mean - previous) / mean))
        if change < SETTLED_CHANGE:
            length = 2 * arb.pi() * mean / integrand.mean
            hi = float(length)
            lo = float(length - hi)
            spread = float(length.rad()) + abs(float(length - hi - lo))
            return Period(hi, lo, (hi * change + spread) * (1.0 + 4.0 * EPSILON))
    return None


class _Integrand:
    """√(L1 L2 / k) as a function of ψ."""

    def __init__(self, stretch: Stretch) -> None:
        lo, hi, x1 = stretch.lo, stretch.hi, stretch.x1
        below = [r for r in stretch.reals if r < lo] + [-1 / x1]
        above = [r for r in stretch.reals if r > hi] + ([x1] if stretch.high_is_root else [])
        # ẋ² has the factor x^(1−μ): a zero of it at 0, unless P's own power of x cancels that.
        power = stretch.radicand.power
        self._power = power - 1
        if stretch.passes_pole:
            self._power = 0
        elif power <= 0:
            below.append(arb(0))
            self._power = power
        L2 = max(below, key=float)
        self._L2 = (lo - L2, hi - L2)
        below.remove(L2)
        if above:
            L1 = min(above, key=float)
            self._L1 = (L1 - lo, L1 - hi)
            above.remove(L1)
        else:
            self._L1 = (arb(1), arb(1))
        self._below, self._above, self._pairs = below, above, stretch.pairs
        self._lo, self._hi = lo, hi
        leading = abs(arb(stretch.radicand.polynomial[stretch.radicand.polynomial.degree()]))
        self._constant = 4 * leading / ball(stretch.radicand.nu)
        a = (self._L1[0] * self._L2[1]).sqrt()
        b = (self._L1[1] * self._L2[0]).sqrt()
        self.mean = a.agm(b)
        self._is_swapped = bool(a > b)
        self._steps = _gauss(b / a if self._is_swapped else a / b)
        self._stretch = self._L1[0] / self._L1[1]

    def __call__(self, psi: arb) -> arb:
        """Return the integrand at 0 < ψ < π/2."""
        # tan φ = √(L1(lo)/L1(hi)) tan χ.
        ratio = self._tan_squared_chi(psi) * self._stretch
        down = 1 / (1 + ratio)
        return self._at(ratio * down, down)

    def at_ends(self) -> tuple[arb, arb]:
        """Return the integrand at 0 and at π/2."""
        return self._at(arb(0), arb(1)), self._at(arb(1), arb(0))

    def _at(self, up: arb, down: arb) -> arb:
        x = self._lo * down + self._hi * up
        k = self._constant
        for r in self._below:
            k *= (self._lo - r) * down + (self._hi - r) * up
        for r in self._above:
            k *= (r - self._lo) * down + (r - self._hi) * up
        for re, im in self._pairs:
            k *= (x - re) ** 2 + im * im
        if self._power:
            k *= x ** (-self._power)
        return 1 / k.sqrt()

    def _tan_squared_chi(self, psi: arb) -> arb:
        """Return tan² χ, with dχ/√(b² cos²χ + a² sin²χ) = dψ/M, by Gauss's transformation of tan² ψ.

        Sums of positive numbers lose no digit, however near a separatrix is.
        """
        sine, cosine = psi.sin_cos()
        tangent = cosine / sine if self._is_swapped else sine / cosine
        square = tangent * tangent
        for growth, complement in self._steps:
            square = growth * square * (1 + square) / (1 + complement * square)
        return 1 / square if self._is_swapped else square


def _gauss(ratio: arb) -> list[tuple[arb, arb]]:
    """Return (1 + κ)² and 1 − κ², κ = c_n/a_n, of the mean of 1 and ``ratio`` ≤ 1, from the precision up."""
    a, b, steps = arb(1), ratio, list[tuple[arb, arb]]()
    small = arb(2) ** (-ctx.prec // 2)
    while True:
        c, before = (a - b) / 2, a
        a, b = (a + b) / 2, (a * b).sqrt()
        # a + c is the a before, and a² − c² = b².
        growth, complement = before / a, b / a
        steps.append((growth * growth, complement * complement))
        if abs(c) < a * small or len(steps) > 40:
            return steps[::-1]


def _zeros(radicand: Radicand) -> tuple[list[arb], tuple[tuple[arb, arb], ...]]:
    """Return the real zeros, growing, and one of each complex pair."""
    whole = fmpz_poly([radicand.polynomial.numer()[k] for k in range(radicand.polynomial.degree() + 1)])
    reals, pairs = [], []
    for root, multiplicity in cast("list[tuple[acb, int]]", whole.complex_roots()):
        if root.imag == 0:
            if multiplicity > 1:
                raise RootsUndecidedError("a zero is multiple")
            reals.append(root.real)
        elif root.imag > 0:
            pairs.extend([(root.real, root.imag)] * multiplicity)
    return sorted(reals, key=arb.mid), tuple(pairs)


def _value(radicand: Radicand, x: arb) -> arb:
    total = arb(0)
    for k in range(radicand.polynomial.degree(), -1, -1):
        total = total * x + arb(radicand.polynomial[k])
    return total


def rational_orbit(radicand: Radicand, motion: PlanarMotion, frame: Frame) -> tuple[Records, Period] | None:
    """Return a loop with its orbit and start, rounded last, and the period; None if not periodic or decided.

    Of ``motion`` only the window and the start count: the curve is that of the radicand.
    """
    for precision in PRECISIONS:
        with ctx.workprec(precision):
            try:
                stretch = find_stretch(radicand, motion.window)
                if stretch is None or not stretch.is_periodic:
                    return None
                return _orbit(stretch, motion, frame.shared.copy())
            except RootsUndecidedError:
                continue
    return None


def _orbit(stretch: Stretch, motion: PlanarMotion, loops: Records) -> tuple[Records, Period] | None:
    loop: Loop = loops[0]
    nu = ball(stretch.radicand.nu)
    loop.z, loop.g = _double((nu * stretch.x1).sqrt()), _double(stretch.x1)
    rotates = stretch.passes_pole and not stretch.high_is_root
    if rotates:
        start = _start_of_rotation(stretch, motion, loop)
        loop.rotates, loop.direction = True, loop.s_sign * loop.half
        sense, kind = 1.0, 0
    else:
        chosen = _libration(stretch, motion, loop)
        if chosen is None:
            return None
        start, sense, kind = chosen
    if start is None:
        return None
    loop.start, loop.sense = start, sense
    _set_roots(stretch, loop, kind)
    period = period_of_x(stretch)
    if period is None:
        return None
    trips = 1.0 if stretch.low_is_root and stretch.high_is_root else 2.0
    return loops, Period(trips * period.hi, trips * period.lo, trips * period.error)


def _start_of_rotation(stretch: Stretch, motion: PlanarMotion, loop: Loop) -> float | None:
    if loop.kind == REST:
        return None
    u = 0.5
    if isinstance(motion.start, StartAtPoint):
        quarter = _point(stretch, motion.start, mirrored=loop.mirrored)
        if quarter is None:
            return None
        u = float(quarter / arb.pi()) if loop.g2_sign > 0.0 else float(1 - quarter / arb.pi())
    return u if loop.s_sign > 0.0 else 2.0 - u


def _point(stretch: Stretch, start: StartAtPoint, *, mirrored: bool) -> arb | None:
    """Return 0 < v < π/2 where the client's |g1| is that of the start, None beyond the equator."""
    size = abs(ball(start.g1))
    # Mirrored, the client's g1 is g3 here: g3² = ν x.
    nu = ball(stretch.radicand.nu)
    x = size * size / nu if mirrored else size
    return _angle(stretch, x) if x < stretch.x1 else None


def _libration(stretch: Stretch, motion: PlanarMotion, loop: Loop) -> tuple[float, float, int] | None:
    """Describe the libration in ``loop``; return u at the start, the sense in u, and the kind of ends."""
    low, high = _angle(stretch, stretch.lo), _angle(stretch, stretch.hi)
    pi = arb.pi()
    if not stretch.high_is_root:
        places, kind = [(low, pi - low)], 1
    elif stretch.passes_pole:
        places, kind = [(-high, high), (pi - high, pi + high)], 2
    else:
        places, kind = [(low, high), (pi - high, pi - low)], 3
    arcs = new_records(ARC, len(places))
    size = 1.0 if not stretch.high_is_root else math.sin(float(high))
    for place, (a, b) in enumerate(places):
        arcs[place] = float(a), float(b), True, True, size, 0
    quarter, half, sine = None, loop.half, 0.0
    if isinstance(motion.start, StartAtPoint):
        quarter = _point(stretch, motion.start, mirrored=loop.mirrored)
        if quarter is None:
            return None
        sine = math.sin(float(quarter))
    start = Start(loop.kind, loop.s_sign, loop.g2_sign, sine)
    chosen, at, sense = choose_start(arcs, len(places), 0, start)
    if chosen < 0:
        return None
    a, b = places[chosen] if half > 0.0 else (-places[chosen][1], -places[chosen][0])
    loop.rotates, loop.half_width = False, _double((b - a) / 2)
    ((loop.s_lower, loop.c_lower), (loop.s_middle, loop.c_middle), (loop.s_upper, loop.c_upper)) = _end_sines(
        stretch, a, b
    )
    if kind == 3 and abs(loop.s_lower) > abs(loop.s_upper):
        kind = 4
    lo, hi = arcs[chosen].lo, arcs[chosen].hi
    if quarter is None:
        u = 0.5 if lo < at < hi else 0.0 if at == lo else 1.0
    else:
        exact = quarter if loop.g2_sign > 0.0 else pi - quarter
        exact += 2 * pi * round((at - float(exact)) / (2.0 * math.pi))
        below, above = exact - places[chosen][0], places[chosen][1] - exact
        if not (below > 0 and above > 0):
            return None
        # Turned before it is rounded: next to an end u is small, and 1 − u is not.
        near, far = (below, above) if half > 0.0 else (above, below)
        return float(2 * arb.atan2(near.sqrt(), far.sqrt()) / pi), sense * half, kind
    if half < 0.0:
        u = 1.0 - u
    return u, sense * half, kind


def _angle(stretch: Stretch, x: arb) -> arb:
    """Return v in [0, π/2] with x = x1 sin² v."""
    return arb.atan2(x.sqrt(), (stretch.x1 - x).nonnegative_part().sqrt())


def _end_sines(stretch: Stretch, a: arb, b: arb) -> list[tuple[float, float]]:
    """Return sine and cosine at the lower end, in the middle (exact zeros there) and at the upper end."""
    sines: list[tuple[float, float]] = []
    middle = (a + b) / 2
    for v in (a, middle, b):
        sine, cosine = v.sin_cos()
        if v is middle and not (stretch.low_is_root and stretch.high_is_root):
            quarters = round(float(2 * middle / arb.pi())) % 4
            sines.append(((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[quarters])
        else:
            sines.append((_double(sine), _double(cosine)))
    return sines


def _set_roots(stretch: Stretch, loop: Loop, kind: int) -> None:
    """Fill in what :func:`.factor_by_roots` needs."""
    polynomial = stretch.radicand.polynomial
    leading = polynomial[polynomial.degree()]
    loop.by_roots, loop.ends = True, kind
    loop.leading, loop.mu = _quotient(leading), float(stretch.radicand.power)
    loop.reals, loop.pairs = len(stretch.reals), len(stretch.pairs)
    for k, root in enumerate(stretch.reals):
        is_below = root < stretch.hi
        distance = stretch.lo - root if is_below else root - stretch.hi
        loop.roots[k] = (-1.0 if is_below else 1.0), _double(distance)
    for k, (real, imaginary) in enumerate(stretch.pairs, start=len(stretch.reals)):
        loop.roots[k] = _double(real), _double(imaginary)


def _quotient(value: fmpq) -> float:
    """Return |value|, rounded once; beyond doubles it is infinite, of which kernels decide nothing."""
    try:
        return abs(int(value.p) / int(value.q))
    except OverflowError:
        return math.inf


def _double(value: arb) -> float:
    """Return the nearest double of a ball that is known well enough."""
    if value != 0 and value.rel_accuracy_bits() < GAP_BITS:
        raise RootsUndecidedError("a distance of roots is not known to the bits of a double")
    return float(value)
