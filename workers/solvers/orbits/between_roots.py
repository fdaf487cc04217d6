"""The stretches between the zeros of a function on which it is positive: where motions of x = |g1| are."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from flint import arb

from service.dynamics.errors import DynamicsError


class RootsUndecidedError(DynamicsError):
    """The precision does not suffice, or two of the roots coincide (a separatrix, an equilibrium)."""

    code = "undecided_roots"


@dataclass(frozen=True, slots=True)
class Between:
    """lo ≤ x ≤ hi with a positive function inside."""

    lo: arb
    hi: arb
    low_is_root: bool
    """Else lo = 0, the pole."""
    high_is_root: bool
    """Else hi is the equator."""


def positive_stretches(
    roots: Sequence[arb], equator: arb, function: Callable[[arb], arb]
) -> tuple[Between, ...]:
    """Return all stretches of 0 ≤ x ≤ ``equator`` on which ``function`` is positive, by growing x.

    ``roots`` are all its simple real zeros but 0, in any order.

    Raises
    ------
    RootsUndecidedError
        Two of 0, the roots and the equator cannot be told apart, or a sign between them is not certain.
    """
    # As balls: doubles may not tell two roots apart.
    inner = sorted((root for root in roots if _is_inside(root, equator)), key=arb.mid)
    if any(not one < other for one, other in pairwise(inner)):
        raise RootsUndecidedError("two roots cannot be told apart")
    edges = [arb(0), *inner, equator]
    found = []
    for place, (lo, hi) in enumerate(pairwise(edges)):
        value = function(((lo + hi) / 2).mid())
        if not (value > 0 or value < 0):
            raise RootsUndecidedError("the sign between two roots")
        if value > 0:
            found.append(Between(lo, hi, place > 0, place < len(edges) - 2))
    return tuple(found)


def _is_inside(root: arb, equator: arb) -> bool:
    if root > 0 and root < equator:
        return True
    if root < 0 or root > equator:
        return False
    raise RootsUndecidedError("a root is at the pole or at the equator")
