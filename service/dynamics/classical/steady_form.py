"""Places the steady rotations of Staude: the axis on its cone, the spin."""

from collections.abc import Sequence
from fractions import Fraction

from flint import arb

from service.dynamics.classical.bodies import Fitting
from service.dynamics.classical.cases import staude
from service.dynamics.classical.errors import CaseNotRealError, CaseParameterError
from service.dynamics.classical.placed import ON_RELATION, Placed, ball, start_of
from service.dynamics.problem import ClassicalMotion


def place_steady(fitting: Fitting, motion: ClassicalMotion) -> Placed:
    """Return the rotation; raises CaseNotRealError, CaseParameterError."""
    body, centre, given = fitting.moments, motion.centre, motion.gamma
    assert given is not None
    if sum(x is None for x in given) > 1 or not any(given):
        raise CaseParameterError("at most one component may be null, and not all 0", pointer="/motion/gamma")
    direction = _on_cone(body, centre, given)
    moments, centres = [ball(m) for m in body], [ball(c) for c in centre]
    length = sum((ball(x) ** 2 for x in direction), arb(0)).sqrt()
    square = staude.spin_squared(moments, centres, [ball(x) / length for x in direction])
    if square is not None and not square.is_finite():
        raise CaseNotRealError(
            "about a principal axis that does not hold the centre no rotation is steady",
            pointer="/motion/gamma",
        )
    if (square is None) != (motion.spin is not None):
        message = "spin is needed about a principal axis that holds the centre, and only there"
        raise CaseParameterError(message, pointer="/motion/spin")
    sign = 1 if square is None or square >= 0 else -1
    spin = ball(motion.spin or Fraction(0)) if square is None else abs(square).sqrt()
    gamma = [sign * ball(x) / length for x in direction]
    omega = [motion.direction * spin * g for g in gamma]
    return Placed(fitting, motion, start_of((*omega, *gamma)), None, None, arb(1), arb(1))


def _on_cone(
    body: Sequence[Fraction], centre: Sequence[Fraction], given: Sequence[Fraction | None]
) -> list[Fraction]:
    missing = next((k for k, x in enumerate(given) if x is None), None)
    if missing is None:
        direction = [x or Fraction(0) for x in given]
        if abs(staude.cone(body, centre, direction)) > ON_RELATION * _size(body, centre, direction):
            raise CaseParameterError(
                "the direction is not on Staude's cone a*(B-C)*g2*g3 + b*(C-A)*g3*g1 + c*(A-B)*g1*g2 = 0; "
                "null is accepted for one component, which then follows",
                pointer="/motion/gamma",
            )
        return direction
    # The cone is linear in each component.
    without, with_one = (
        [e if k == missing else x or Fraction(0) for k, x in enumerate(given)] for e in (0, 1)
    )
    constant = staude.cone(body, centre, without)
    slope = staude.cone(body, centre, with_one) - constant
    if slope == 0:
        raise CaseParameterError(
            "the component that is null does not follow from the other two: the cone holds "
            f"{'every' if constant == 0 else 'no'} value of it; give another one",
            pointer="/motion/gamma",
        )
    return [Fraction(-constant / slope) if k == missing else x or Fraction(0) for k, x in enumerate(given)]


def _size(body: Sequence[Fraction], centre: Sequence[Fraction], g: Sequence[Fraction]) -> Fraction:
    """Return the size of the terms that cancel on the cone."""
    (A, B, C), (a, b, c), (x, y, z) = body, centre, g
    return abs(a * (B - C) * y * z) + abs(b * (C - A) * z * x) + abs(c * (A - B) * x * y)
