r"""The phase θ in which motions in three-term potentials are elliptic functions, and its time.

On an interval lo ≤ x ≤ hi with x = lo cos²v + hi sin²v the phase grows uniformly with time: a quarter turn
of θ is a quarter turn of v, and its rate is half of the arithmetic-geometric mean of two numbers a and b.
They are defined in :mod:`workers.solvers.closed_form.elliptic`.
"""

from fractions import Fraction

from flint import arb

from service.dynamics.reduction.geometry.loop import ball
from workers.solvers.three_terms.carlson import R_F
from workers.solvers.three_terms.intervals import MotionInterval


def primed_nu(lambda_squared: Fraction, *, mirrored: bool) -> arb:
    """Return nu = λ² in primed axes: λ is raised to −A/C = −1/2 where they are mirrored."""
    return ball(lambda_squared).rsqrt() if mirrored else ball(lambda_squared)


def trip_time(interval: MotionInterval) -> arb:
    """Return the time in which g1 goes from lo to hi and back."""
    a, b = moduli(interval)
    return 2 * arb.pi() / a.agm(b)


def phase_at(interval: MotionInterval, sine: arb, cosine: arb) -> arb:
    """Return θ, where sin v and cos v are these: a quarter turn of θ is a quarter turn of v."""
    a, b = moduli(interval)
    (low, high), _ = interval.linear_factors()
    # tan χ = tan v · √(L1(hi)/L1(lo)).
    s, c = abs(sine) * high.sqrt(), abs(cosine) * low.sqrt()
    norm = s * s + c * c
    x = (b * b * c * c).nonnegative_part()
    quarter = a.agm(b) * s * R_F(x, x + a * a * s * s, b * b * norm)
    theta = arb.pi() - quarter if cosine < 0 else quarter
    return -theta if sine < 0 else theta


def moduli(interval: MotionInterval) -> tuple[arb, arb]:
    """Return a and b, of which half the arithmetic-geometric mean is the rate of the phase."""
    first, second = interval.linear_factors()
    factor = interval.curve.factor
    return (factor * first[0] * second[1]).sqrt(), (factor * first[1] * second[0]).sqrt()
