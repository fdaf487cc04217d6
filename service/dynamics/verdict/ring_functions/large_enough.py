"""Computes in a ring that is large enough: tries again in a larger one as long as it is not."""

from collections.abc import Callable
from typing import TypeVar

from service.dynamics.verdict.exact_ring.layout import Layout, LayoutTooSmallError, NoProofError
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.exact_ring.work import Work
from service.dynamics.verdict.ring_functions.ring_algebra import RingAlgebra

T = TypeVar("T")

MAX_RESTARTS = 60
"""Larger rings that are tried before the proof is abandoned."""


def in_large_enough_ring(
    layout: Layout,
    signs: tuple[int, int, int],
    compute: Callable[[Ring, RingAlgebra], T],
    work: Work | None = None,
    *,
    keeps_kinks: bool = False,
) -> tuple[Ring, T]:
    """Return the first ring, from ``layout`` on, that is large enough for ``compute``, and what it returns.

    Parameters
    ----------
    signs
        Of g1, g2, g3 in the octant of the ring.
    work
        What the proof has spent in other rings; None for one that begins here.

    keeps_kinks
        See :class:`RingAlgebra`.

    Raises
    ------
    NoProofError
        The ring keeps growing; and what ``compute`` raises.
    """
    for _ in range(MAX_RESTARTS):
        ring = Ring(layout, signs, work)
        try:
            return ring, compute(ring, RingAlgebra(ring, keeps_kinks=keeps_kinks))
        except LayoutTooSmallError as error:
            layout = error.layout
    raise NoProofError("the ring keeps growing")
