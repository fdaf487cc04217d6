"""Target 6, the certified tier against what it replaces, and what it costs elsewhere."""

from collections.abc import Callable
from fractions import Fraction
from time import process_time

import mpmath
import numpy as np
from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.problem import PlanarMotion, StartAtEquator
from service.dynamics.solution.dense_output import as_decimals
from tests.benchmarks.measuring import Effort, Result, Row, Table, clock, faster, in_words, median
from tests.benchmarks.motions import Measured, elliptic
from tests.support.hard_problems import FUNCTIONS
from tests.support.planar import body, formula
from tests.support.witnesses.general_motion import GeneralMotion
from workers.solvers.certified.certify import Certified
from workers.solvers.certified.validated.enclose import Enclosure
from workers.solvers.certified.validated.enclose import enclose as enclose_steps
from workers.solvers.certified.validated.system import EulerPoisson
from workers.solvers.choose import enclose

DIGITS = 38
"""Precision of mpmath: what 128 bits hold."""
ON_4_5 = PlanarMotion(Fraction(4, 5))
NOT_EVEN = "(A*g1^2 + C*g3^2)*(g2^2 - 1/2 + g2^3/5)"


def periods(effort: Effort) -> list[Row]:
    """Compare periods at 128 bits with quadrature of the same integral in mpmath."""
    other = body(3, 1)
    cases: tuple[tuple[str, Measured, Callable[[], mpmath.mpf]], ...] = (
        ("elliptic functions", elliptic(), _elliptic_period),
        ("an integral, A = 3C", Measured("", other, formula(NOT_EVEN, other), ON_4_5), _general_period),
    )
    rows = []
    for name, motion, by_mpmath in cases:
        found = _certified(motion, [], 128)
        value, radius = as_decimals(found.period)
        seconds = median(lambda: _certified(motion, [], 128), effort.repeats(20))  # noqa: B023
        theirs = median(by_mpmath, effort.repeats(5))
        with mpmath.workdps(DIGITS + 10):
            error = float(abs(by_mpmath() - mpmath.mpf(value)))
        ours = Result("certified", seconds, float(radius), "the radius")
        rival = Result(f"mpmath.quad, {DIGITS} digits", theirs, error)
        what = f"period at 128 bits by {name}"
        rows.append(faster(6, what, 8, 1e-36, ours, rival, asked="≥ 8×, 128 bits"))
    return rows


def samples(effort: Effort) -> list[Row]:
    """Compare 1000 samples over 10 periods, all six variables proven, with an integrator in doubles."""
    motion = elliptic()
    grid = motion.grid(0, 10)
    times = [Fraction(t) for t in grid.tolist()]
    found = _certified(motion, times, 64)
    widest = max(float(value.rad()) for state in found.states for value in state)
    ours = Result(
        "certified, 64 bits", median(lambda: _certified(motion, times, 64), effort.repeats(5)), widest,
        "the radius",
    )  # fmt: skip
    state = motion.state()
    theirs = median(lambda: motion.by_scipy(state, grid, 1e-10), effort.repeats(5))
    error = motion.error(grid, np.asarray(motion.by_scipy(state, grid, 1e-10)))
    rival = Result("DOP853 1e-10", theirs, error)
    what = "1000 certified samples, 10 periods"
    return [faster(6, what, 1, 2.0**-56, ours, rival, asked="faster, 64 bits")]


STATE = tuple(map(Fraction, ("1/3", "1/2", "1", "3/5", "0", "4/5")))
MOMENTS = tuple(map(Fraction, (2, "3/2", 1)))


def steps(effort: Effort) -> list[Row]:
    """Compare a heavy body, proven by steps from a state to t = 10, with mpmath's Taylor series."""
    t = Fraction(10)
    found = _by_steps("-g1", t, 64)
    seconds = median(lambda: _by_steps("-g1", t, 64), effort.repeats(3))
    began = clock()
    theirs = _by_odefun(t)
    rival_seconds = clock() - began
    error = max(
        float(abs(arb(text) - x).abs_upper()) for text, x in zip(theirs, found.states[0], strict=True)
    )
    widest = max(float(value.rad()) for value in found.states[0])
    ours = Result("proven steps, 64 bits", seconds, widest, "the radius")
    rival = Result("mpmath.odefun, 19 digits", rival_seconds, error, "proves nothing")
    return [faster(6, "a heavy body to t = 10", 1, 2.0**-56, ours, rival, asked="≤ 1 s, 64 bits")]


def long_steps(effort: Effort) -> Table:
    """Return what proven steps cost over long times, for more bits, and of a body whose neighbours part."""
    chaotic = "-4*g1 - 6*g2 + 2*g3 + 8*g1*g2 - 6*g3^2"
    cases = (
        ("heavy body", "-g1", 10, 64), ("heavy body", "-g1", 100, 64), ("heavy body", "-g1", 10, 128),
        ("heavy body", "-g1", 10, 333),
        ("wall 1/g3²", "-g1 + 1/20/g3^2", 10, 64), ("chaotic", chaotic, 50, 64),
    )  # fmt: skip
    rows = []
    for name, text, t, bits in cases[: 1 if effort.is_quick else None]:
        began = clock()
        found = _by_steps(text, Fraction(t), bits)
        seconds = clock() - began
        assert found.forward is not None
        count = str(len(found.forward.stretches))
        rows.append((name, str(t), str(bits), str(found.precision), count, in_words(seconds)))
    heads = ("motion", "t", "bits", "precision", "steps", "seconds")
    return Table("The certified tier by proven steps from a state", "One run of each.", heads, tuple(rows))


def _by_steps(text: str, t: Fraction, bits: int) -> Enclosure:
    system = EulerPoisson(RigidBody(*MOMENTS), compile_tape(parse(text)))
    return enclose_steps(system, lambda: [ball(x) for x in STATE], [t], bits)


def _by_odefun(t: Fraction) -> list[str]:
    """Return the state as decimals; V = -g1."""
    A, B, C = (mpmath.mpf(m.numerator) / m.denominator for m in MOMENTS)

    def rates(_: mpmath.mpf, y: list[mpmath.mpf]) -> list[mpmath.mpf]:
        p, q, r, g1, g2, g3 = y
        return [
            (B - C) * q * r / A,
            ((C - A) * p * r - g3) / B,
            ((A - B) * p * q + g2) / C,
            r * g2 - q * g3,
            p * g3 - r * g1,
            q * g1 - p * g2,
        ]

    with mpmath.workdps(19):
        start = [mpmath.mpf(x.numerator) / x.denominator for x in STATE]
        found = mpmath.odefun(rates, 0, start)(int(t))
        return [mpmath.nstr(x, 19) for x in found]


def others(effort: Effort) -> Table:
    """Return what motions without elliptic functions cost, for three precisions."""
    cases = (
        ("A = 3C, not even in g2", 3, NOT_EVEN, "4/5"),
        ("A = 4C, through the poles", 4, "-g1*(4*g1^2+3*g3^2) + (4*g1^2+g3^2)/10", "9/10"),
        ("A = 1.7C", "17/10", "(A*g1^2 + C*g3^2)*(g2^2 - 1/2)", "6/5"),
    )
    rows = []
    for name, A, text, lambda_ in cases[: 1 if effort.is_quick else None]:
        rigid_body = body(A, 1)
        motion = Measured(name, rigid_body, formula(text, rigid_body), PlanarMotion(Fraction(lambda_)))
        times = [Fraction(k, 10) for k in range(1000)]
        for bits in (64, 128, 333):
            alone = _once(motion, [], bits)
            sampled = _once(motion, times, bits)
            radius = _power_of_ten(_certified(motion, [], bits).period.rad())
            rows.append((name, str(bits), in_words(alone), in_words(sampled), radius))
    heads = ("motion", "bits", "period alone", "1000 samples", "radius of the period")
    return Table("The certified tier by the integral", "One run of each.", heads, tuple(rows))


RATIOS = (*map(Fraction, ("3/2", "2", "3", "6/5", "101/100", "100")),)


def integrals(effort: Effort) -> Table:
    """Return what encloses motions through poles where V1 may stay an integral, beside quadratures."""
    ratios = [*RATIOS, *(1 / ratio for ratio in RATIOS)]
    rows = [
        (F, str(ratio), *_of_integral(F, ratio))
        for ratio in ratios[: 1 if effort.is_quick else None]
        for F in FUNCTIONS
    ]
    heads = ("F", "A/C", "answer", "seconds of the processor", "radius", "apart from the quadrature")
    return Table("The certified tier where V1 is an integral", CIRCUMSTANCES, heads, tuple(rows))


CIRCUMSTANCES = (
    "G = 0, λ = 1, from the equator on, 64 bits, one sample, one run of each. Radius and distance are the "
    "largest of the six variables; the quadrature is one of mpmath, of formulas without any series. A "
    "distance above the radius would be a wrong answer."
)


def _of_integral(F: str, ratio: Fraction) -> tuple[str, str, str, str]:
    rigid_body = body(ratio, 1)
    with mpmath.workdps(34), ctx.workprec(160):
        witness = GeneralMotion(FUNCTIONS[F], _number(ratio), mpmath.mpf(1), mpmath.mpf(1))
        u = mpmath.mpf(1) / 4
        is_real = not isinstance(witness.time_to(u), mpmath.mpc)
        times = [Fraction(mpmath.nstr(witness.time_to(u), 34)) if is_real else Fraction(1)]
        potential = general_potential(rigid_body, F, "0", {})
        began = process_time()
        try:
            motion = PlanarMotion(Fraction(1), start=StartAtEquator(-1))
            found = enclose(rigid_body, potential, motion, times, 64)
        except DynamicsError as error:
            return error.code, in_words(process_time() - began), "", ""
        seconds = process_time() - began
        true = [arb(mpmath.nstr(value, 34)) for value in witness.north_of(u)]
        radius = max(float(ball.rad()) for ball in found.states[0])
        apart = max(float(abs(ball.mid() - x)) for ball, x in zip(found.states[0], true, strict=True))
        return found.method, in_words(seconds), f"{radius:.1e}", f"{apart:.1e}"


def _number(value: Fraction) -> mpmath.mpf:
    return mpmath.mpf(value.numerator) / value.denominator


def _once(motion: Measured, times: list[Fraction], bits: int) -> float:
    began = clock()
    _certified(motion, times, bits)
    return clock() - began


def _certified(motion: Measured, times: list[Fraction], bits: int) -> Certified:
    return enclose(motion.body, motion.potential, motion.motion, times, bits)


def _elliptic_period() -> mpmath.mpf:
    """Return 2 ∫ dθ / √k, x = lo cos²(θ/2) + hi sin²(θ/2), x'² = (x − lo)(hi − x) k(x)."""
    with mpmath.workdps(DIGITS):
        lo, hi = mpmath.mpf(1) / 10, (mpmath.sqrt(5) - 1) / 2

        def rate(theta: mpmath.mpf) -> mpmath.mpf:
            half = mpmath.cos(theta / 2) ** 2
            x = lo * half + hi * (1 - half)
            return 1 / mpmath.sqrt(2 * (x + 1 / hi))

        return 4 * mpmath.quad(rate, [0, mpmath.pi])


def _general_period() -> mpmath.mpf:
    """Return 2 ∫ dθ / (Q √k), g2 = y = m − h cos θ, s² = (y − ya)(yb − y) k(y), s² = −2 G(y)/(A C)."""
    with mpmath.workdps(DIGITS):
        roots = sorted(mpmath.polyroots([mpmath.mpf(1) / 5, 1, 0, mpmath.mpf(-1) / 2], extraprec=200))
        third, lower, upper = (mpmath.re(root) for root in roots)
        square = mpmath.mpf(16) / 25

        def rate(theta: mpmath.mpf) -> mpmath.mpf:
            half = mpmath.cos(theta / 2) ** 2
            y = lower * half + upper * (1 - half)
            # u = |g1|^(2/3) solves u³ + λ² u = 1 − y².
            w = (1 - y * y) / 2
            root = mpmath.cbrt(w + mpmath.sqrt(w * w + (square / 3) ** 3))
            u = root - square / (3 * root)
            return 1 / ((3 * u**3 + square * u) * mpmath.sqrt(2 * (y - third) / 15))

        return 2 * mpmath.quad(rate, [0, mpmath.pi])


def _power_of_ten(radius: arb) -> str:
    """Return the size of a radius, which may be below any double."""
    return radius.str(2, radius=False)
