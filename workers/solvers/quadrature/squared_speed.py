r"""Bounds (dθ/dt)² about a stretch of phases, and proves that it is holomorphic there.

The inverse square of the rate dt/dθ is the simple part of it: for the phases of
:mod:`workers.solvers.orbits.orbit` and :mod:`.flight` it is c² P times elementary functions. It has no root
and no quotient by P, so it is holomorphic wherever the potential is, beyond the zeros of P too, and a bound
from above is all that is needed of it (:mod:`.panel`).
"""

from collections.abc import Hashable
from dataclasses import dataclass, field
from functools import lru_cache

from flint import arb, ctx

from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import NoClosedFormError
from workers.solvers.assembly.time_map import TimeMap
from workers.solvers.orbits.orbit import Libration, Rotation
from workers.solvers.quadrature.complex_radicand import complex_radicand
from workers.solvers.quadrature.ellipse import BranchedSpeed, PhaseSpeed
from workers.solvers.quadrature.flight import Flight
from workers.solvers.quadrature.kinks import Branch, branches
from workers.solvers.quadrature.speeds import FlightSpeed, LibrationSpeed, RotationSpeed, Speed
from workers.solvers.quadrature.time_map import make_time_map

KEPT = 4
"""Time maps that are remembered: a job may ask for that of one motion in several tiers and by two methods."""


def time_map_of(orbit: Libration | Rotation | Flight) -> TimeMap:
    """Return the time of an orbit or a flight over one turn of its phase, proved if V has a formula.

    Raises
    ------
    QuadratureNotConvergedError, PrecisionLostError
        As :func:`.time_map.make_time_map`.
    """
    return _known(_Asked(_identity(orbit), orbit))


@dataclass(frozen=True, slots=True)
class _Asked:
    """An orbit or a flight, told from others by all that its time depends on."""

    identity: Hashable
    way: Libration | Rotation | Flight = field(compare=False)


@lru_cache(maxsize=KEPT)
def _known(asked: _Asked) -> TimeMap:
    way = asked.way
    return make_time_map(way.rate, way.corners, is_even=way.is_even, speed=phase_speed(way))


def _identity(orbit: Libration | Rotation | Flight) -> Hashable:
    """Return what tells one time map from another, to the last bit of every ball."""
    loop = orbit.loop
    curve = (loop.A, loop.C, loop.mirrored, loop.g1_sign, loop.lambda_squared, _exact(loop.Z), _exact(loop.G))
    # A potential without a formula is the same only if it is the same object, which the cache keeps.
    potential: Hashable = loop.potential if loop.potential.has_formula else id(loop.potential)
    about: tuple[Hashable, ...]
    if isinstance(orbit, Libration):
        about = _exact(orbit.lower), _exact(orbit.upper), orbit.corners
    elif isinstance(orbit, Rotation):
        about = _exact(orbit.origin), orbit.direction, orbit.corners
    else:
        ends = _exact(orbit.arc.lower), _exact(orbit.arc.upper)
        about = *ends, orbit.direction, orbit.has_rest, orbit.first, orbit.last, orbit.corners
    return type(orbit), ctx.prec, potential, curve, about


def _exact(value: arb) -> Hashable:
    if not value.is_finite():
        return str(value)
    return *value.mid().man_exp(), *value.rad().man_exp()


def phase_speed(orbit: Libration | Rotation | Flight) -> PhaseSpeed | BranchedSpeed | None:
    """Return the bounds for an orbit or a flight, at the current precision; None without a formula of V."""
    try:
        tape = orbit.loop.potential.tape
    except NoClosedFormError:
        return None
    loop, h = orbit.loop, orbit.loop.energy(orbit.somewhere())
    passed = None if isinstance(orbit, Rotation) else frozenset(_poles(orbit))

    def along(tape: Tape) -> Speed:
        radicand = complex_radicand(loop, tape, h, passed)
        if isinstance(orbit, Libration):
            return LibrationSpeed(orbit, radicand)
        if isinstance(orbit, Rotation):
            return RotationSpeed(orbit, radicand)
        return FlightSpeed(orbit, radicand)

    whole = along(tape)

    def places(left: float, right: float) -> tuple[arb, arb, arb] | None:
        half = (arb(right) - arb(left)) / 2
        return whole.radicand.gamma(whole.place(arb.pi() * ((arb(left) + arb(right)) / 2 + arb(0, half))))

    found = branches(tape, places, orbit.corners, 1.0 if orbit.is_even else 2.0)
    if len(found) == 1:
        return whole if found[0].tape == tape else along(found[0].tape)
    return _Branched(tuple((branch, along(branch.tape)) for branch in found))


@dataclass(frozen=True, slots=True)
class _Branched:
    """Bounds that are those of other formulas on other stretches."""

    parts: tuple[tuple[Branch, Speed], ...]

    @property
    def kinks(self) -> tuple[tuple[float, float], ...]:
        """See BranchedSpeed.kinks."""
        return tuple((branch.left, branch.right) for branch, _ in self.parts if branch.is_kink)

    @property
    def edges(self) -> tuple[float, ...]:
        """See BranchedSpeed.edges."""
        return (*(branch.left for branch, _ in self.parts), self.parts[-1][0].right)

    def on(self, left: float, right: float) -> PhaseSpeed:
        """See BranchedSpeed.on."""
        return next(speed for branch, speed in self.parts if branch.left <= left and right <= branch.right)


def _poles(orbit: Libration | Flight) -> list[int]:
    """Return the numbers v/π of the poles on the way."""
    lower, upper = (
        (orbit.lower, orbit.upper) if isinstance(orbit, Libration) else (orbit.arc.lower, orbit.arc.upper)
    )
    return [k for k in range(-4, 5) if lower < arb.pi() * k and arb.pi() * k < upper]
