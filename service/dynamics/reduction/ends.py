"""Names and errors for ends of motions that the quadrature cannot handle."""

from flint import arb

from service.dynamics.errors import DynamicsError
from service.dynamics.reduction.arc import Arc, ArcEnd
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.root_finding.orders import HIGHEST_ORDER
from service.dynamics.reduction.window import Window


class LeavesDomainError(DynamicsError):
    """The motion runs into the edge of where the potential is defined."""

    code = "leaves_domain"


class FlatZeroError(DynamicsError):
    """p² vanishes at an end of the motion, and not as a power of the distance from it."""

    code = "flat_zero"


class StandstillError(DynamicsError):
    """The motion comes to rest after a finite time at a place that it may leave at any later one."""

    code = "standstill"


def require_known_ends(window: Window) -> None:
    """Refuse a motion whose end is not one that the quadrature knows the way to.

    Raises
    ------
    LeavesDomainError
        It runs out of the potential's domain.
    FlatZeroError
        p² vanishes at an end, but not as a power of the distance from it.
    StandstillError
        It vanishes there as a power between the first and the second: the motion has no one continuation.
    """
    still = [end for arc in window.arcs for end in _ends_of(arc, "standstill")]
    if still:
        raise StandstillError(
            f"p² vanishes at g2 = {still[0]:.15g} like a power of the distance between the first and the "
            "second: the motion comes to rest there after a finite time, and may go on at any later one, so "
            "that the equations do not say where it is; accepted are windows without such an end",
            pointer="/potential",
        )
    flat = [end for arc in window.arcs for end in _ends_of(arc, "flat")]
    if flat:
        raise FlatZeroError(
            f"p² vanishes at g2 = {flat[0]:.15g}, where the motion ends, and is like no whole power of the "
            f"distance up to the {HIGHEST_ORDER}th: when it comes near that place cannot be computed by "
            'quadrature; accepted there is the method "integration"',
            pointer="/potential",
        )
    if window.kind == "edge":
        raise LeavesDomainError(
            f"the potential is defined on the curve only for g2 between {window.g2[0]:.15g} and "
            f"{window.g2[1]:.15g}, and the motion does not turn back before",
            pointer="/potential",
        )


def height(loop: Loop, v: arb) -> float:
    """Return g2 at v, exactly ±1 or 0 where the loop passes a pole or the equator."""
    sine, cosine = v.sin_cos()
    if sine.contains(arb(0)):
        return 1.0 if cosine > 0 else -1.0
    if cosine.contains(arb(0)):
        return 0.0
    return float(loop.point_from(sine, cosine).g2)


def _ends_of(arc: Arc, kind: ArcEnd) -> list[float]:
    """Return g2 at the ends of this kind of an arc that is no point."""
    ends = ((arc.lower_end, arc.lower), (arc.upper_end, arc.upper))
    return [height(arc.loop, v) for end, v in ends if end == kind and arc.lower is not arc.upper]
