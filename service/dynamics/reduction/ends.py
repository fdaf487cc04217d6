"""Names and errors for ends of motions that the quadrature cannot handle."""

from flint import arb

from service.dynamics.errors import DynamicsError
from service.dynamics.reduction.arc import Arc
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.root_finding.orders import HIGHEST_ORDER
from service.dynamics.reduction.window import Window


class LeavesDomainError(DynamicsError):
    """The motion runs into the edge of where the potential is defined."""

    code = "leaves_domain"


class FlatZeroError(DynamicsError):
    """p² vanishes at an end of the motion, and not as a power of the distance from it."""

    code = "flat_zero"


def require_known_ends(window: Window) -> None:
    """Refuse a motion whose end is not one that the quadrature knows the way to.

    Raises
    ------
    LeavesDomainError
        It runs out of the potential's domain.
    FlatZeroError
        p² vanishes at an end, but not as a power of the distance from it.
    """
    flat = [end for arc in window.arcs for end in _flat_ends(arc)]
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


def _flat_ends(arc: Arc) -> list[float]:
    """Return g2 at the ends of the arc where p² vanishes as no power."""
    ends = ((arc.lower_end, arc.lower), (arc.upper_end, arc.upper))
    return [height(arc.loop, v) for end, v in ends if end == "flat" and arc.lower is not arc.upper]
