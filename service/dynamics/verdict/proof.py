"""The exact route: L(V) = 0 proved formally, octant by octant where signs matter."""

from dataclasses import dataclass

from service.dynamics.body import RigidBody
from service.dynamics.formula.tape import Tape
from service.dynamics.verdict.fields import VectorFields
from service.dynamics.verdict.layout import Layout, LayoutTooSmallError, NoProofError, UndefinedInOctantError
from service.dynamics.verdict.natures import Element
from service.dynamics.verdict.ring import Ring
from service.dynamics.verdict.ring_algebra import RingAlgebra

MAX_RESTARTS = 60
"""Each restart enlarges the ring by a root or by atoms; formulas need a handful."""

Signs = tuple[int, int, int]


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


def prove(body: RigidBody, tape: Tape) -> Proof | None:
    """Return the proof that L(V) = 0 on the sphere, or None if there is none this way.

    None means refuted *or* not decided: atoms may hide a relation, or the
    polynomials are too large. The proof speaks of points where V has a value;
    whether there are any is for the caller to see.
    """
    octants: list[EnergyInOctant] = []
    sign_dependent: set[int] = set()
    pending: list[Signs] = [(1, 1, 1)]
    done: set[Signs] = set()
    layout = Layout()
    while pending:
        signs = pending.pop()
        done.add(signs)
        try:
            ring, H, vanishes = _examine(body, tape, layout, signs, sign_dependent)
        except UndefinedInOctantError:
            pass
        except NoProofError:
            return None
        else:
            layout = ring.layout
            if not vanishes:
                return None
            octants.append(EnergyInOctant(signs, ring, H))
        pending = [octant for octant in _octants(sign_dependent) if octant not in done]
    return Proof(frozenset(sign_dependent), tuple(octants)) if octants else None


def _examine(
    body: RigidBody, tape: Tape, layout: Layout, signs: Signs, sign_dependent: set[int]
) -> tuple[Ring, Element, bool]:
    """Return the ring that was large enough, H, and whether ΞH = 0; note the signs that mattered."""
    for _ in range(MAX_RESTARTS):
        ring = Ring(layout, signs)
        try:
            algebra = RingAlgebra(ring)
            fields = VectorFields(body, algebra, ring)
            V = tape.evaluate(algebra, [ring.coordinate(position) for position in range(3)])
            H = fields.H(V)
            return ring, H, ring.normal(fields.derivative("along", H)).is_zero
        except LayoutTooSmallError as error:
            layout = error.layout
        finally:
            sign_dependent |= ring.sign_dependent
    raise NoProofError("the ring keeps growing")


def _octants(sign_dependent: set[int]) -> list[Signs]:
    octants: list[Signs] = [(1, 1, 1)]
    for position in sorted(sign_dependent):
        flipped = [(*s[:position], -1, *s[position + 1 :]) for s in octants]
        octants += [(s[0], s[1], s[2]) for s in flipped]
    return octants
