"""Proves L(V) = 0 by exact algebra, octant by octant where signs matter."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from service.dynamics.body import RigidBody
from service.dynamics.formula.tape import Tape
from service.dynamics.verdict.exact_ring.generators import Element
from service.dynamics.verdict.exact_ring.layout import (
    Layout,
    NoProofError,
    UndefinedInOctantError,
    Work,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.ring_functions.fields import VectorFields
from service.dynamics.verdict.ring_functions.ring_algebra import RingAlgebra, in_large_enough_ring

Signs = tuple[int, int, int]
Assumption = tuple[Tape, Literal[1, -1]]
"""A formula in g1, g2, g3 with the sign that it has."""


@dataclass(frozen=True, slots=True)
class EnergyInOctant:
    """H as an element of the ring of its octant."""

    signs: Signs
    ring: Ring
    H: Element


@dataclass(frozen=True, slots=True)
class Proof:
    """L(V) = 0 wherever V is defined and smooth.

    ``octants`` holds H for each octant where the formula can have a value; one
    entry stands for all octants if ``sign_dependent`` (positions 0, 1, 2 of
    g1, g2, g3) is empty.
    """

    sign_dependent: frozenset[int]
    octants: tuple[EnergyInOctant, ...]


def prove(body: RigidBody, tape: Tape, assumptions: Sequence[Assumption] = ()) -> Proof | None:
    """Return the proof that L(V) = 0 on the sphere, or None if there is none this way.

    With ``assumptions``, on the part of the sphere where they all hold.

    None means refuted *or* not decided: atoms may hide a relation, or the
    polynomials are too large. The proof is about points where V has a value;
    the caller checks that there are any.
    """
    octants: list[EnergyInOctant] = []
    sign_dependent: set[int] = set()
    pending: list[Signs] = [(1, 1, 1)]
    done: set[Signs] = set()
    layout, work = Layout(), Work()
    while pending:
        signs = pending.pop()
        done.add(signs)
        try:
            ring, (H, vanishes) = _examine(body, tape, assumptions, layout, work, signs, sign_dependent)
        except UndefinedInOctantError:
            pass
        except NoProofError:
            return None
        else:
            layout = ring.layout
            if not vanishes:
                return None
            octants.append(EnergyInOctant(signs, ring, H))
        pending = [octant for octant in octants_of(sign_dependent) if octant not in done]
    return Proof(frozenset(sign_dependent), tuple(octants)) if octants else None


def _examine(
    body: RigidBody,
    tape: Tape,
    assumptions: Sequence[Assumption],
    layout: Layout,
    work: Work,
    signs: Signs,
    sign_dependent: set[int],
) -> tuple[Ring, tuple[Element, bool]]:
    """Return the ring that was large enough, H, and whether ΞH = 0; note the signs that mattered."""

    def compute(ring: Ring, algebra: RingAlgebra) -> tuple[Element, bool]:
        try:
            fields = VectorFields(body, algebra, ring)
            coordinates = [ring.coordinate(position) for position in range(3)]
            for assumed, sign in assumptions:
                algebra.assume(assumed.evaluate(algebra, coordinates), sign)
            V = tape.evaluate(algebra, coordinates)
            H = fields.H(V)
            return H, ring.normal(fields.derivative("along", H)).is_zero
        finally:
            sign_dependent.update(ring.sign_dependent)

    return in_large_enough_ring(layout, signs, compute, work)


def octants_of(sign_dependent: Iterable[int]) -> list[Signs]:
    """Return the octants that differ in the signs of these coordinates."""
    octants: list[Signs] = [(1, 1, 1)]
    for position in sorted(sign_dependent):
        flipped = [(*s[:position], -1, *s[position + 1 :]) for s in octants]
        octants += [(s[0], s[1], s[2]) for s in flipped]
    return octants
