"""Places the motions of Hess: a state with no momentum along the centre."""

from fractions import Fraction

from flint import arb

from service.dynamics.classical.bodies import Fitting
from service.dynamics.classical.cases import hess
from service.dynamics.classical.errors import CaseParameterError
from service.dynamics.classical.loop import ReducedLoop, loops
from service.dynamics.classical.placed import ON_RELATION, Placed, ball, start_of
from service.dynamics.problem import ClassicalMotion

ZERO_AREAS = arb(2) ** -200
"""An areas integral below it is zero: that is the rounding of the state."""


def place_hess(fitting: Fitting, motion: ClassicalMotion) -> Placed:
    """Return the motion from a state; raises CaseParameterError if it is not one of the case."""
    assert motion.omega is not None
    assert motion.gamma is not None
    frame, (A, B, C) = fitting.frame, fitting.moments
    a, _, c = frame.vector(motion.centre)
    omega = list(motion.omega)
    first, second, third = frame.axes
    given = [omega[first], omega[third]]
    if omega[second] is None or given == [None, None]:
        message = "of the components of omega one may be null: one of the two in the plane of the centre"
        raise CaseParameterError(message, pointer="/motion/omega")
    # In the client's axes both the momentum and the centre have the signs of the frame.
    along = [A * motion.centre[first], C * motion.centre[third]]
    if given[0] is None:
        omega[first] = -along[1] * (given[1] or Fraction(0)) / along[0]
    elif given[1] is None:
        omega[third] = -along[0] * given[0] / along[1]
    else:
        parts = [along[0] * given[0], along[1] * given[1]]
        if abs(parts[0] + parts[1]) > ON_RELATION * (abs(parts[0]) + abs(parts[1])):
            raise CaseParameterError(
                "the momentum along the centre is not zero: A*a*p + C*c*r (in the axes of the centre) "
                f"is {float(parts[0] + parts[1]):.3e}; null is accepted for one of them, which follows",
                pointer="/motion/omega",
            )
        # The relation is not stable: what rounding has left of it would grow.
        omega[third] = -parts[0] / along[1]
    gamma = [ball(x or Fraction(0)) for x in motion.gamma]
    length = sum((g * g for g in gamma), arb(0)).sqrt()
    start = start_of((*(ball(x or Fraction(0)) for x in omega), *(g / length for g in gamma)))
    own = [ball(x) for x in (*frame.axial(start.omega), *frame.vector(start.gamma))]
    p, q, r, g1, g2, g3 = own
    MA, MB, MC = (ball(m) for m in (A, B, C))
    G = (ball(a) ** 2 + ball(c) ** 2).sqrt()
    h = (MA * p * p + MB * q * q + MC * r * r) / 2 + ball(a) * g1 + ball(c) * g3
    areas = MA * p * g1 + MB * q * g2 + MC * r * g3
    reduced = hess.reduced(MB, G, h, areas if abs(areas) > ZERO_AREAS else arb(0))
    square = MA * MA * p * p + MB * MB * q * q + MC * MC * r * r
    place = square if len(reduced.V) == 4 else square.sqrt()
    # At rest the momentum has no angle to begin with: such a motion is integrated.
    is_at_rest = bool(place == 0)
    loop = None if is_at_rest else next((each for each in loops(reduced) if _holds(each, place)), None)
    return Placed(fitting, motion, start, reduced, loop, arb(1), arb(1))


def _holds(loop: ReducedLoop, place: arb) -> bool:
    margin = arb(2) ** -180 * (loop.upper - loop.lower)
    return bool(loop.lower - margin < place) and bool(place < loop.upper + margin)
