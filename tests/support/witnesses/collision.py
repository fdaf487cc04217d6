r"""The time to a collision with g3 = 0, which b1 < 0 leads to.

.. math:: t = \int_{y}^{x} \frac{d\xi}{\sqrt{\frac2C\,(x_1-\xi)(\xi-x_2)(-P(\xi))}}
            = \sqrt{2C}\,R_F(U_{12}^2, U_{13}^2, U_{14}^2)

with the four linear factors a_i + b_i ξ under the root, real or in a complex
pair, X_i and Y_i their square roots at x and at y, and (Carlson 1995)

.. math:: U_{ij} = \frac{X_iX_jY_kY_l + Y_iY_jX_kX_l}{x-y} .
"""

from fractions import Fraction

from flint import acb, arb

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.potentials.recognition import ThreeTerms
from workers.solvers.three_terms import MotionInterval, ThreeTermCurve, intervals, make_curve

_Linear = tuple[acb, acb]


class NoCollisionError(DynamicsError):
    """No motion on this curve runs into g3 = 0 from there."""

    code = "no_collision"


def collision_time(
    terms: ThreeTerms,
    body: RigidBody,
    nu: Fraction,
    *,
    x: Fraction | None = None,
    is_rising: bool = False,
) -> arb:
    """Return the time from |g1| = ``x`` to the collision, enclosed at the current precision.

    Parameters
    ----------
    nu
        g3²/g1, with the sign of g1.
    x
        Default: the largest |g1| of the motion.
    is_rising
        |g1| grows at first: the motion turns at its largest.

    Raises
    ------
    NoCollisionError
        b1 ≥ 0, or ``x`` is not between 0 and the largest |g1|.
    RootsUndecidedError
        Two roots coincide: the time from one of them is infinite.
    """
    curve = make_curve(terms, min(body.A, body.C), ball(abs(nu)), 1 if nu > 0 else -1)
    lowest = next((each for each in intervals(curve) if each.lo_end == "collision"), None)
    if lowest is None or (x is not None and not (x > 0 and ball(x) <= lowest.hi)):
        raise NoCollisionError("the motion never reaches g3 = 0 from there", pointer="/motion")
    if x is None:
        return _time(lowest, arb(0), None)
    falling = _time(lowest, arb(0), ball(x))
    return falling + 2 * _time(lowest, ball(x), None) if is_rising else falling


def _factors(curve: ThreeTermCurve) -> tuple[_Linear, ...]:
    """Return four factors with the product (x1 − x)(x − x2)(−P)."""
    one, constant = acb(1), acb(-curve.constant)
    kinetic = (acb(curve.x1), -one), (-acb(curve.x2), one)
    if curve.terms.c1 == 0:
        return (*kinetic, (constant, acb(-curve.linear)), (one, acb(0)))
    discriminant = curve.discriminant
    if discriminant < 0:
        root = (acb(-curve.linear) + acb(discriminant).sqrt()) / acb(2 * curve.quadratic)
        first, second = root, root.conjugate()
    else:
        first, second = (acb(root) for root in curve.roots())
    # −P = −P(0) (1 − x/x')(1 − x/x'').
    return (*kinetic, (constant, -constant / first), (one, -one / second))


def _time(interval: MotionInterval, low: arb, high: arb | None) -> arb:
    """Return the time between two x; a ``high`` of None is the turning point, where one factor vanishes."""
    factors = _factors(interval.curve)
    top = interval.hi if high is None else high
    X = [_root(a + b * top, is_zero=high is None) for a, b in factors]
    Y = [_root(a + b * low) for a, b in factors]
    width = acb(top - low)

    def U_squared(j: int) -> acb:
        k, m = (i for i in (1, 2, 3) if i != j)
        U = (X[0] * X[j] * Y[k] * Y[m] + Y[0] * Y[j] * X[k] * X[m]) / width
        return U * U

    squares = (U_squared(j) for j in (1, 2, 3))
    return (2 * acb.elliptic_rf(*squares) / acb(interval.curve.factor).sqrt()).real


def _root(value: acb, *, is_zero: bool = False) -> acb:
    """Return the principal square root, 0 for a ball around 0 that ``is_zero`` tells to be that."""
    return acb(0) if is_zero and value.contains(acb(0)) else value.sqrt()
