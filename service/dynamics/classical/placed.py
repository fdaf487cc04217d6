"""A classical motion in the client's axes and units: where it is at time 0, and its scale."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from flint import arb, fmpq

from service.dynamics.body import RigidBody
from service.dynamics.classical.bodies import Fitting
from service.dynamics.classical.loop import ReducedLoop
from service.dynamics.classical.protocol import ClassicalCase, rational
from service.dynamics.classical.reduced import Number, Reduced, State
from service.dynamics.problem import ClassicalMotion

ON_RELATION = Fraction(1, 10**15)
"""Relative: a state that satisfies a relation so closely means the one that satisfies it."""


@dataclass(frozen=True, slots=True)
class Start:
    """A state in the client's axes, 77 digits of it."""

    omega: tuple[Fraction, Fraction, Fraction]
    gamma: tuple[Fraction, Fraction, Fraction]


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
    p, q, r, g1, g2, g3 = (rational(x) for x in state)
    return Start((p, q, r), (g1, g2, g3))


def ball(number: Fraction) -> arb:
    """Return a rational as a ball."""
    return arb(fmpq(number.numerator, number.denominator))
