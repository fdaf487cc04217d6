"""Places a classical motion in the client's axes: the body, the order of axes, the scale, the first state.

Steady rotations (Staude) are placed by the axis on its cone and the spin, motions of Hess by a state with no
momentum along the centre, all others by their phase on the loop of the reduced motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.classical.bodies import Fitting, Partly, fittings
from service.dynamics.classical.cases import hess, staude
from service.dynamics.classical.protocol import (
    CASE_BITS,
    ClassicalCase,
    Number,
    Reduced,
    ReducedLoop,
    Setting,
    State,
    loops,
)
from service.dynamics.errors import CaseMomentsError, CaseNotRealError, CaseParameterError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.problem import ClassicalMotion
from service.dynamics.solution.dense_output import exact_middle

RELATION_RELATIVE_ROUNDING = Fraction(1, 10**15)
"""Relative: a state that satisfies a relation so closely means the one that satisfies it."""


@dataclass(frozen=True, slots=True)
class Start:
    """A state in the client's axes, 154 digits of it."""

    omega: tuple[Fraction, Fraction, Fraction]
    gamma: tuple[Fraction, Fraction, Fraction]
    balls: tuple[arb, ...] = field(default=(), compare=False)
    """Enclosures of the six variables, of CASE_BITS bits."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A classical motion of a body; see :func:`place`."""

    fitting: Fitting
    motion: ClassicalMotion
    start: Start
    reduced: Reduced | None
    """The reduced motion of the forms ``loop`` and ``hess``, in balls."""
    loop: ReducedLoop | None
    """None for steady rotations, and for Hess if the momentum keeps its length or is zero at first."""
    speed: arb
    """The client's angular velocities over those of the reduced motion."""
    strength: arb
    """The length of T."""

    @property
    def case(self) -> ClassicalCase:
        """The case."""
        return self.fitting.case

    @property
    def body(self) -> RigidBody:
        """The body, with all its moments."""
        return self.fitting.body

    def first_angle(self) -> arb:
        """Return θ at time 0, of the form ``loop``."""
        assert self.loop is not None
        return 2 * arb.pi() * self.loop.turns * ball(self.motion.phase)

    def in_client_axes(
        self, state: State, speed: Number | None = None, strength: Number | None = None
    ) -> tuple[Number, ...]:
        """Return p, q, r, g1, g2, g3 of a state of the reduced motion; not of the form ``hess``.

        ``speed`` and ``strength`` are those of the motion, in numbers that go with those of the state.
        """
        p, q, r, T1, T2, T3 = state
        frame, turn = self.fitting.frame, self.motion.sign
        pace = self.motion.direction * (self.speed if speed is None else speed)
        size = self.strength if strength is None else strength
        omega = frame.axial_back((pace * p, turn * pace * q, turn * pace * r))
        return (*omega, *frame.vector_back((T1 / size, turn * T2 / size, turn * T3 / size)))

    def own_state(
        self, omega: Sequence[Number], gamma: Sequence[Number], speed: Number, strength: Number
    ) -> State:
        """Return the state of the reduced motion; ``speed`` and ``strength`` are those of the motion."""
        p, q, r = self.fitting.frame.axial(omega)
        x, y, z = self.fitting.frame.vector(gamma)
        return p / speed, q / speed, r / speed, x * strength, y * strength, z * strength


def start_of(state: Sequence[arb]) -> Start:
    """Return a state as rationals."""
    p, q, r, g1, g2, g3 = (exact_middle(x) for x in state)
    return Start((p, q, r), (g1, g2, g3), tuple(state))


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
        if abs(staude.cone(body, centre, direction)) > RELATION_RELATIVE_ROUNDING * _size(
            body, centre, direction
        ):
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


ZERO_AREAS_ROUNDING = arb(2) ** -200
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
        if abs(parts[0] + parts[1]) > RELATION_RELATIVE_ROUNDING * (abs(parts[0]) + abs(parts[1])):
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
    reduced = hess.reduced(MB, G, h, areas if abs(areas) > ZERO_AREAS_ROUNDING else arb(0))
    square = MA * MA * p * p + MB * MB * q * q + MC * MC * r * r
    place = square if len(reduced.V) == 4 else square.sqrt()
    # At rest the momentum has no angle to begin with: such a motion is integrated.
    is_at_rest = bool(place == 0)
    loop = None if is_at_rest else next((each for each in loops(reduced) if _holds(each, place)), None)
    return Placed(fitting, motion, start, reduced, loop, arb(1), arb(1))


def _holds(loop: ReducedLoop, place: arb) -> bool:
    margin = arb(2) ** -180 * (loop.upper - loop.lower)
    return bool(loop.lower - margin < place) and bool(place < loop.upper + margin)


def place(motion: ClassicalMotion, moments: Partly, *, allow_unphysical: bool = False) -> Placed:
    """Return the motion of the body with these moments, None for those left out.

    Raises
    ------
    CaseCentreError, CaseMomentsError, CaseConditionError, UnphysicalInertiaError
        As :func:`.fittings`.
    CaseNotRealError
        The motion is not real; the message has the range in which it is.
    CaseParameterError
        A state does not satisfy the relations of its case.
    """
    refusal, found = CaseNotRealError(""), list[Placed]()
    with ctx.workprec(CASE_BITS):
        for fitting in fittings(motion, moments, allow_unphysical=allow_unphysical):
            try:
                found.append(FORMS[fitting.case.form](fitting, motion))
            except CaseNotRealError as error:
                refusal = error
    if not found:
        raise refusal
    # The same body in another order of axes is another one if moments were left out: the first order holds.
    found = [each for each in found if each.fitting.frame == found[0].fitting.frame]
    bodies = [(float(b.A), float(b.B or 0), float(b.C)) for b in (each.body for each in found)]
    if len(set(bodies)) > 1:
        told = "; ".join(f"A = {A:.15g}, B = {B:.15g}, C = {C:.15g}" for A, B, C in sorted(set(bodies)))
        more = " or the solution" if found[0].case.ratios is not None else ""
        raise CaseMomentsError(
            f"several bodies have these moments: {told}; give another moment{more}", pointer="/body"
        )
    return found[0]


def _place_loop(fitting: Fitting, motion: ClassicalMotion) -> Placed:
    case = fitting.case
    setting = _setting(fitting, motion)
    assert case.reduce is not None
    reduced = case.reduce(setting)
    is_finite = all(c.is_finite() for c in (*reduced.U, *reduced.V)) and not reduced.rate.contains(0)
    found = list(loops(reduced)) if is_finite else []
    strength = found[-1].strength() if found else arb(0)
    if not strength > 0:
        field = "energy" if "energy" in case.parameters else ""
        A, B, C = (float(moment) for moment in fitting.moments)
        raise CaseNotRealError(
            f"the case {case.name} has no real motion here (moments {A:.15g}, {B:.15g}, {C:.15g} in its "
            f"order of the axes); real is {case.about.real}",
            pointer=f"/motion/{field}" if field else "/body",
        )
    speed = (setting.strength / strength).sqrt() if case.is_scaled else arb(1)
    # Of mirror images about x = 0 any one will do: the others are its direction or its phase.
    placed = Placed(fitting, motion, _NOWHERE, reduced, found[-1], speed, strength)
    return replace(placed, start=start_of(placed.in_client_axes(found[-1].state(placed.first_angle()))))


def _setting(fitting: Fitting, motion: ClassicalMotion) -> Setting:
    A, B, C = fitting.moments
    a, _, c = fitting.frame.vector(motion.centre)
    parameters = dict[str, arb]()
    if motion.p is not None:
        axis = fitting.frame.axes[0]
        p, _, _ = fitting.frame.axial([motion.p if k == axis else Fraction(0) for k in range(3)])
        parameters["p"] = ball(p)
    if motion.energy is not None:
        parameters["energy"] = ball(motion.energy / A)
    return Setting(ball(B / A), ball(C / A), ball(a / A), ball(c / A), parameters)


_ZERO = (Fraction(0), Fraction(0), Fraction(0))
_NOWHERE = Start(_ZERO, _ZERO)
FORMS = {"loop": _place_loop, "steady": place_steady, "hess": place_hess}
