"""The certified tier against what it replaces: ``python -m tests.benchmarks.certified``."""

import statistics
import sys
import time
from collections.abc import Callable
from fractions import Fraction

import mpmath
import numpy as np
from flint import arb
from scipy.integrate import solve_ivp

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from tests.support.planar import body, formula
from workers.solvers.certified.certify import certify
from service.dynamics.enclosure import as_decimals

DIGITS = 38
"""Of mpmath: what 128 bits hold."""
NU_1 = PlanarMotion(None, nu=Fraction(1))
ON_4_5 = PlanarMotion(Fraction(4, 5))
NOT_EVEN = "(A*g1^2 + C*g3^2)*(g2^2 - 1/2 + g2^3/5)"


def main() -> int:
    """Measure and print."""
    periods()
    samples()
    others()
    return 0


def periods() -> None:
    """Compare periods at 128 bits with quadrature of the same integral in mpmath."""
    cases = (
        ("A = 2C, V = -g1 + 1/(20 g3²), nu = 1: elliptic", 2, "-g1 + 1/(20*g3^2)", NU_1, _elliptic_period),
        ("A = 3C, V = Q (g2² - 1/2 + g2³/5), λ = 4/5", 3, NOT_EVEN, ON_4_5, _general_period),
    )
    for name, A, text, motion, rival in cases:
        rigid_body = body(A, 1)
        potential = formula(text, rigid_body)
        value, radius = as_decimals(certify(rigid_body, potential, motion, [], 128).period)
        ours = median(lambda: certify(rigid_body, potential, motion, [], 128), 20)  # noqa: B023
        theirs = median(rival, 3)
        with mpmath.workdps(DIGITS + 10):
            error = abs(rival() - mpmath.mpf(value))
        say(f"period at 128 bits, {name}")
        say(f"  certified     {1e3 * ours:9.3f} ms   radius {float(radius):.1e}")
        say(
            f"  mpmath.quad   {1e3 * theirs:9.3f} ms   error  {float(error):.1e}   ratio {theirs / ours:8.1f}"
        )


def samples() -> None:
    """Compare 1000 samples over 10 periods, all six variables, with an integrator in doubles."""
    rigid_body = body(2, 1, "3/2")
    potential = formula("-g1 + 1/(20*g3^2)", rigid_body)
    period = Fraction(float(certify(rigid_body, potential, NU_1, [], 64).period))
    times = [10 * period * k / 999 for k in range(1000)]
    found = certify(rigid_body, potential, NU_1, times, 64)
    exact = np.array([[float(value) for value in state] for state in found.states])
    grid = np.array([float(t) for t in times])
    by_scipy = _integrator(rigid_body, potential, exact[0], grid)
    ours = median(lambda: certify(rigid_body, potential, NU_1, times, 64), 5)
    theirs = median(by_scipy, 3)
    widest = max(float(value.rad()) for state in found.states for value in state)
    error = float(np.abs(by_scipy() - exact).max())
    say("1000 samples of six variables over 10 periods, 64 bits, the same motion")
    say(f"  certified     {1e3 * ours:9.1f} ms   radius {widest:.1e}")
    say(f"  DOP853 1e-10  {1e3 * theirs:9.1f} ms   error  {error:.1e}   ratio {theirs / ours:8.1f}")


def others() -> None:
    """Print what motions without elliptic functions cost, for three accuracies."""
    cases = (
        ("A = 3C, not even in g2", 3, NOT_EVEN, "4/5"),
        ("A = 4C, through the poles", 4, "-g1*(4*g1^2+3*g3^2) + (4*g1^2+g3^2)/10", "9/10"),
        ("A = 1.7C", "17/10", "(A*g1^2 + C*g3^2)*(g2^2 - 1/2)", "6/5"),
    )
    say("by the integral: the period alone, with 1000 samples")
    for name, A, text, lambda_ in cases:
        rigid_body = body(A, 1)
        potential, motion = formula(text, rigid_body), PlanarMotion(Fraction(lambda_))
        times = [Fraction(k, 10) for k in range(1000)]
        for bits in (64, 128, 333):
            alone = median(lambda: certify(rigid_body, potential, motion, [], bits), 1)  # noqa: B023
            sampled = median(lambda: certify(rigid_body, potential, motion, times, bits), 1)  # noqa: B023
            radius = certify(rigid_body, potential, motion, [], bits).period.rad()
            say(
                f"  {name:<26} {bits:4d} bits {1e3 * alone:8.0f} ms {1e3 * sampled:8.0f} ms"
                f"   radius of the period {_power_of_ten(radius)}"
            )


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


def _integrator(
    rigid_body: RigidBody, potential: Potential, state: np.ndarray, grid: np.ndarray
) -> Callable[[], np.ndarray]:
    A, B, C = float(rigid_body.A), float(rigid_body.B or 0), float(rigid_body.C)

    def rhs(_: float, y: np.ndarray) -> tuple[float, ...]:
        p, q, r, g1, g2, g3 = y.tolist()
        V_1, V_2, V_3 = potential.gradient_at(g1, g2, g3)
        return (
            ((B - C) * q * r + g2 * V_3 - g3 * V_2) / A,
            ((C - A) * p * r + g3 * V_1 - g1 * V_3) / B,
            ((A - B) * p * q + g1 * V_2 - g2 * V_1) / C,
            r * g2 - q * g3,
            p * g3 - r * g1,
            q * g1 - p * g2,
        )

    return lambda: solve_ivp(rhs, (0, grid[-1]), state, "DOP853", grid, rtol=1e-10, atol=1e-10).y.T


def _power_of_ten(radius: arb) -> str:
    """Return the size of a radius, which may be below any double."""
    return radius.str(2, radius=False)


def median(action: Callable[[], object], repeats: int) -> float:
    """Return the median time of a warm call in seconds."""
    action()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        action()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
