r"""Computes D = g1 V_3 − g3 V_1 and its derivatives along the curve, in any algebra.

The field

.. math:: X = A g_1 g_2\,\partial_1 - Q\,\partial_2 + C g_3 g_2\,\partial_3,\qquad Q = A g_1^2 + C g_3^2,

leads along every curve |g3| = λ |g1|^{C/A}, from the pole g2 = 1 to g2 = −1: X is a positive multiple of
d/dv for 0 < v < π, smooth up to the poles and without a root. So X D > 0 all over a stretch of the curve
means that D grows there and has one zero at most; where X² D has one sign D has two at most, and so on.
"""

from collections.abc import Sequence
from fractions import Fraction
from typing import Any, Generic, NamedTuple, TypeVar  # Any: jets of jets have no type of finite length

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.jets import FirstOrderJets, Jet
from service.dynamics.formula.tape import Tape

T = TypeVar("T")


class _WithJumps(FirstOrderJets[T]):
    """First-order jets in which sign(x) has a derivative, 0, only where x is not 0.

    Elsewhere it is no number: what jumps may have any number of zeros.
    """

    def call(self, name: str, argument: Jet[T]) -> Jet[T]:
        if name != "sign" or argument.first is self._zeros:
            return super().call(name, argument)
        base = self._base
        nothing, one = base.constant(Fraction(0)), base.constant(Fraction(1))
        rate = base.multiply(nothing, base.divide(one, argument.value))
        return Jet(base.call(name, argument.value), tuple([rate for _ in argument.first]))


class SecondScale(NamedTuple, Generic[T]):
    """A further input of a formula, a function u of g2, and X u: for derivatives up to the first."""

    u: T
    rate: T


def derivatives_along(
    algebra: Algebra[T],
    tape: Tape,
    body: RigidBody,
    g: Sequence[T],
    order: int,
    beside: Sequence[SecondScale[T]] = (),
) -> list[T | None]:
    """Return D, X D, … up to the derivative of this order at g = (g1, g2, g3), None where it is 0.

    ``beside`` is for a tape that has such inputs beside g1, g2 and g3.
    """
    assert not beside or order <= 1
    inner: Any = algebra
    places: Any = [*g, *(each.u for each in beside)]
    for _ in range(order):
        following = _WithJumps(inner, 1)
        rates = [*rates_along(inner, body, places[:3]), *(each.rate for each in beside)]
        places = [following.seed(place, (rate,)) for place, rate in zip(places, rates, strict=True)]
        inner = following
    turned = _WithJumps(inner, 1)
    g1, g2, g3, *rest = places
    seeds = [turned.seed(g1, (inner.negate(g3),)), turned.seed(g2, (None,)), turned.seed(g3, (g1,))]
    found = tape.evaluate(turned, [*seeds, *(turned.seed(u, (None,)) for u in rest)]).first[0]
    parts: list[T | None] = []
    for depth in range(order + 1):
        part: Any = found
        for level in range(order):
            # The derivatives are taken first, then the value as often as is left.
            part = None if part is None else part.first[0] if level < depth else part.value
        parts.append(part)
    return parts


def rates_along(algebra: Algebra[T], body: RigidBody, g: Sequence[T]) -> list[T]:
    """Return X g1, X g2 and X g3."""
    g1, g2, g3 = g
    A, C = algebra.constant(body.A), algebra.constant(body.C)
    first, third = algebra.multiply(A, g1), algebra.multiply(C, g3)
    Q = algebra.add(algebra.multiply(first, g1), algebra.multiply(third, g3))
    return [algebra.multiply(first, g2), algebra.negate(Q), algebra.multiply(third, g2)]
