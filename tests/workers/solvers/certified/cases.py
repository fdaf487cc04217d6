"""Certified motions in few words, and how a ball is compared with printed digits."""

from fractions import Fraction

from flint import arb, ctx

from service.dynamics.problem import PlanarMotion
from tests.support.planar import body, formula
from workers.solvers.certified.certify import Certified
from workers.solvers.choose import enclose

COMPARED_BITS = 2000
"""Differences of balls are taken with so many bits: nothing is added to them."""

SEPARATRIX = Fraction(
    "0.809016994374947424102293417182819058860154589902881431067724311352630231409451228194486"
)
"""(1 + √5)/4 to far more digits than are compared: c1 where a1 = −1, nu = 1 have a separatrix."""


def three_terms(
    text: str, *, nu="1", times=(), bits=128, A=2, C=1, methods=("elliptic", "integral"), **motion
) -> Certified:
    """Certify a motion of a body with A = 2C on g3² = nu g1."""
    rigid_body = body(A, C)
    asked = [Fraction(t) for t in times]
    return enclose(
        rigid_body,
        formula(text, rigid_body),
        PlanarMotion(None, nu=Fraction(nu), **motion),
        asked,
        bits,
        methods=methods,
    )


def contains_printed(ball: arb, printed: str) -> bool:
    """Say whether the ball meets what was rounded to these digits, and is narrower than the last."""
    decimals = len(printed.partition("e")[0].partition(".")[2]) - int(printed.partition("e")[2] or 0)
    with ctx.workprec(COMPARED_BITS):
        unit = arb(10) ** -decimals
        return bool(abs(ball - arb(printed)).lower() <= unit) and bool(ball.rad() < unit)


def is_inside(inner: arb, outer: arb) -> bool:
    """Say whether one ball lies in another, but for the rounding of the inner radius."""
    with ctx.workprec(COMPARED_BITS):
        return bool(abs(inner.mid() - outer.mid()) <= outer.rad())


def overlap(one: Certified, two: Certified) -> bool:
    """Say whether the two have a motion in common."""
    pairs = [(one.period, two.period), (one.energy, two.energy)]
    for here, there in zip(one.states, two.states, strict=True):
        pairs.extend(zip(here, there, strict=True))
    return all(a.overlaps(b) for a, b in pairs)
