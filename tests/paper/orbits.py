"""Motions of the service for the tests of the paper: states along its orbits, in balls."""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

import pytest
from flint import arb, ctx, fmpq

from service.dynamics.problem import PlanarMotion, Start
from service.dynamics.reduction.window import starting_point
from service.dynamics.reduction.windows import choose_window, find_windows
from tests.support.planar import Exact, body, formula
from workers.solvers.orbits.orbit import make_orbit

BITS = 160
"""Precision of the balls of the orbits, as in the service's reduction."""
ROOM = 60
"""Bits that the differences, roots and powers of an orbit may cost: what is compared is known to 100."""


@dataclass(frozen=True)
class State:
    """The six variables of one of the service's orbits and what determines it, in balls."""

    A: arb
    C: arb
    lambda_: arb
    h: arb
    p: arb
    q: arb
    r: arb
    g1: arb
    g2: arb
    g3: arb
    V: arb
    D: arb
    """g1 V_3 - g3 V_1."""

    @property
    def Q(self) -> arb:
        return self.A * self.g1**2 + self.C * self.g3**2


def motion_on(number: Exact, *, nu: bool = False, start: Start | None = None) -> PlanarMotion:
    value = Fraction(number)
    return PlanarMotion(None if nu else value, value if nu else None, start=start)


@cache
def orbit_states(
    moments: tuple[Exact, Exact], text: str, motion: PlanarMotion, count: int = 7
) -> tuple[State, ...]:
    """Return ``count`` states along one period of the service's orbit."""
    rigid_body = body(*moments)
    potential = formula(text, rigid_body)
    with working_precision():
        windows = find_windows(rigid_body, potential, motion)
        start = starting_point(choose_window(windows, motion), motion)
        orbit = make_orbit(start)
        loop = start.arc.loop
        h, A, C = loop.energy(orbit.somewhere()), ball(rigid_body.A), ball(rigid_body.C)
        lambda_ = ball(motion.lambda_squared).sqrt()
        states = []
        for k in range(count):
            # Irregular phases: no symmetry of the orbit maps one to another.
            p, q, r, *g = orbit.state(arb.pi() * (2 * k + 1) * 2 / (2 * count + 1) + arb(1) / 8)
            V, D = potential.value_ball(*g), potential.D_ball(*g)
            states.append(State(A, C, lambda_, h, p, q, r, g[0], g[1], g[2], V, D))
    return tuple(states)


def working_precision() -> AbstractContextManager[object]:
    return ctx.workprec(BITS)


def ball(value: Exact) -> arb:
    exact = Fraction(value)
    return arb(fmpq(exact.numerator, exact.denominator))


def agree(one: arb, two: arb) -> bool:
    """Say whether two balls overlap, both being known to BITS - ROOM bits of 1."""
    width = arb(2) ** (ROOM - BITS)
    known = all(side.is_finite() and side.rad() < width for side in (one, two))
    return known and bool(one.overlaps(two))


ORBITS = {
    "Bobylev-Steklov": ((2, 1), "-g1", motion_on("13/10", nu=True)),
    "rest to equator": ((2, 1), "-g1 + 1/(20*g3^2)", motion_on(1)),
    "rest to rest": ((2, 1), "-g1 + 1/50/g3^2 + 6/5*(g1^2 - g2^2)", motion_on(1)),
    "alpha = 4": ((4, 1), "-g1*(4*g1^2+3*g3^2) + (4*g1^2+g3^2)/10", motion_on("9/10")),
    "G not even": ((3, 1), "(3*g1^2+g3^2)*(g2^2 - 1/2 + g2^3/5)", motion_on("4/5")),
    "A < C": ((3, 5), "-(3*g1^2+5*g3^2)*(1 - g2^2/2)", motion_on("6/5")),
}
on_every_orbit = pytest.mark.parametrize("name", ORBITS)


def states(name: str) -> tuple[State, ...]:
    return orbit_states(*ORBITS[name])
