"""States and references for tests of integration."""

from fractions import Fraction

import heyoka
import numpy as np

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from tests.support.golden import GOLDEN
from tests.support.heyoka_integrator import HEYOKA

BODY = RigidBody(Fraction(2), Fraction(3, 2), Fraction(1))
NAMES = ("taylor", HEYOKA, "dop853")


def golden_states(name: str) -> dict[int, np.ndarray]:
    """Return the golden states p, q, r, g1, g2, g3 at t = 0, 1, 10."""
    states = next(golden.states for golden in GOLDEN if golden.name == name)
    return {t: np.array([row[0], "0", *row[1:]], dtype=float) for t, row in states.items()}


def planar_state(body: RigidBody, potential: Potential, gamma: tuple[float, float, float], s_sign: int = 1):
    """Return p, q, r, g1, g2, g3 of the planar motion through gamma: s² = D / ((A-C) A C g1 g3)."""
    A, C = float(body.A), float(body.C)
    g1, _, g3 = gamma
    s = s_sign * np.sqrt(float(potential.D(np.array(gamma))) / ((A - C) * A * C * g1 * g3))
    return np.array([-C * g3 * s, 0.0, A * g1 * s, *gamma])


def long_double(value: Fraction) -> np.longdouble:
    return np.longdouble(value.numerator) / np.longdouble(value.denominator)


def reference(body: RigidBody, terms, state, times: np.ndarray) -> np.ndarray:
    """Integrate V = Σ c g1^i g2^j g3^k in 64-bit significands, from exact rationals.

    ``terms`` are (c, i, j, k); the gradient is written down term by term: nothing
    here is shared with the solvers but heyoka itself, at 2000 times finer rounding.
    """
    p, q, r, *g = heyoka.make_vars("p", "q", "r", "g1", "g2", "g3")

    def power(x, n: int):
        product = heyoka.expression(np.longdouble(1))
        for _ in range(abs(n)):
            product = product * x
        return product if n >= 0 else heyoka.expression(np.longdouble(1)) / product

    V = [heyoka.expression(np.longdouble(0)) for _ in range(3)]
    for c, *exponents in terms:
        for axis, n in enumerate(exponents):
            if n:
                factors = [power(g[i], m - (i == axis)) for i, m in enumerate(exponents)]
                V[axis] = V[axis] + (long_double(c) * n) * factors[0] * factors[1] * factors[2]
    A, B, C = (long_double(moment) for moment in (body.A, body.B, body.C))
    equations = [
        (p, ((B - C) * q * r + g[1] * V[2] - g[2] * V[1]) / A),
        (q, ((C - A) * p * r + g[2] * V[0] - g[0] * V[2]) / B),
        (r, ((A - B) * p * q + g[0] * V[1] - g[1] * V[0]) / C),
        (g[0], r * g[1] - q * g[2]),
        (g[1], p * g[2] - r * g[0]),
        (g[2], q * g[0] - p * g[1]),
    ]
    stepper = heyoka.taylor_adaptive(
        equations,
        [long_double(Fraction(x)) for x in state],
        fp_type=np.longdouble,
        tol=np.longdouble("1e-22"),
        compact_mode=True,
        high_accuracy=True,
        opt_level=0,
    )
    rows = {}
    for t in sorted(set(times.tolist()), key=abs):
        if t < float(stepper.time):
            stepper.time = np.longdouble(0)
            stepper.state[:] = [long_double(Fraction(x)) for x in state]
        stepper.propagate_until(np.longdouble(t))
        rows[t] = np.array(stepper.state, dtype=float)
    return np.array([rows[t] for t in times.tolist()])
