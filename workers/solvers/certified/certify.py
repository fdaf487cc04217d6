"""Solves a periodic planar motion with a proof of every digit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from math import floor

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.motion import COLUMNS, EnclosureMethod
from service.dynamics.numerics import largest
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.recognition import recognise
from service.dynamics.problem import ClassicalMotion, PlanarMotion, StateMotion
from service.dynamics.reduction.geometry.loop import make_loop
from workers.solvers.assembly.families import SYMMETRIC_POLE_PASSAGE
from workers.solvers.certified.by_integral import FindArc, IntegralMotion, motion_by_integral, periodic_window
from workers.solvers.certified.elliptic import EllipticMotion, elliptic_motion
from workers.solvers.errors import CertifiedUnavailableError, PrecisionNeededError
from workers.solvers.three_terms import RootsUndecidedError

GUARD_BITS = 32
SPARE_PERIOD_BITS = 5
"""Bits by which the remainder of the integral is smaller than what was asked."""
WORD_BITS = 64
"""Numbers are stored in words of so many bits: all of a word costs what one bit of it does."""
ALLOWED_BITS = 8
"""Radii are at most 2^(ALLOWED_BITS − bits), relative to numbers above 1 and to the period."""
HIGHEST_PRECISION = 2048


@dataclass(frozen=True, slots=True)
class Certified:
    """Enclosures of a motion: every ball contains the true number."""

    period: arb | None
    """The common period of all six variables; None if it is not known."""
    energy: arb
    states: tuple[tuple[arb, ...], ...]
    """(p, q, r, g1, g2, g3) at the asked times."""
    times: tuple[arb, ...]
    """These times."""
    bits: int
    method: EnclosureMethod
    conventions: tuple[str, ...] = ()
    """Choices made where the equations leave one, as of :class:`~service.dynamics.motion.Motion`."""
    areas: arb = field(default_factory=arb)
    """The areas integral, 0 of planar motions."""
    geometric: arb = field(default_factory=partial(arb, 1))
    """γ·γ, 1 of planar motions."""
    columns: tuple[str, ...] = COLUMNS
    """The names of what ``states`` have: after the six variables those of the attitude, if it is proven."""
    precession: tuple[arb, arb] | None = None
    """The gains of ψ1 and ψ3 in a period, if they are proven."""


_Motion = EllipticMotion | IntegralMotion


def certify(
    body: RigidBody,
    potential: Potential,
    motion: PlanarMotion | StateMotion | ClassicalMotion,
    times: Sequence[Fraction],
    bits: int,
    *,
    methods: Sequence[EnclosureMethod] = ("elliptic", "integral"),
    about_a_period: float | None = None,
    find_arc: FindArc | None = None,
) -> Certified:
    """Return enclosures of the period, the energy and the six variables at ``times``, t = 0 being the start.

    Parameters
    ----------
    potential
        An admissible one: that the motion with q = 0 exists is taken from the verdict.
    bits
        Radii are at most 2^(8 − bits), of numbers above 1 and of the period relative to them.
    methods
        In the order in which they are asked: elliptic functions, where the potential has the three terms; the
        integral, of any potential with a formula.
    about_a_period
        If given, ``times`` are numbers of periods, and this is the period, roughly: whole periods
        are left out exactly, whatever the period is.
    find_arc
        What may know, in doubles, the arc that the integral is taken on; it is proven then, which is much
        quicker than to look for windows in balls.

    Raises
    ------
    CertifiedUnavailableError
        The motion is not planar, not periodic or not analytic, the potential has
        no formula, or too many bits would be needed.
    NoMotionError, SeveralWindowsError, NoSuchWindowError, StartOutsideWindowError, LeavesDomainError
        The motion asked for is not there, or not the only one.
    """
    if not isinstance(motion, PlanarMotion):
        raise CertifiedUnavailableError("it is not a planar one", pointer="/motion/type")
    in_periods = about_a_period is not None
    latest = max((abs(t) for t in times), default=Fraction(0))
    if about_a_period is not None:
        latest = Fraction(about_a_period)
    precision, wanted = first_try(bits, latest)
    # With more precision less is left over of the integral, too.
    unused = precision - wanted
    widest: float | None = None
    while precision <= HIGHEST_PRECISION:
        with ctx.workprec(precision):
            try:
                for name, make in _makers(body, potential, motion, precision - unused, methods, find_arc):
                    made = make()
                    if made is None:
                        continue
                    states = made.states(_reduced(made, times) if in_periods else [ball(t) for t in times])
                    named = _conventions(body, potential, motion) if made.passes_pole else ()
                    unit = made.period if in_periods else arb(1)
                    asked = tuple(ball(t) * unit for t in times)
                    result = Certified(made.period, made.energy, states, asked, bits, name, named)
                    if _is_narrow(result):
                        return result
                    before, widest = widest, _widest(result)
                    if made.passes_pole and before is not None and not widest < before / 2.0:
                        raise CertifiedUnavailableError(
                            "at a time that is asked for it is next to a pole, and more bits do not tell it"
                        )
                    break
            except RootsUndecidedError:
                # Or two roots coincide: then the motion is not periodic.
                periodic_window(body, potential, motion)
            except PrecisionNeededError:
                pass
        precision += precision // 2
    raise CertifiedUnavailableError(f"{HIGHEST_PRECISION} bits are not enough")


def first_try(bits: int, latest: Fraction) -> tuple[int, int]:
    """Return the precision that serves most motions, and to how many bits the integral is wanted there."""
    late = int(latest).bit_length()
    return -(-(bits + GUARD_BITS + late) // WORD_BITS) * WORD_BITS, bits + SPARE_PERIOD_BITS + late


def _reduced(made: _Motion, turns: Sequence[Fraction]) -> list[arb]:
    """Return the times within the first period at which the states are those after so many ``turns``."""
    period = made.period if turns else arb(0)
    return [ball(turn - floor(turn)) * period for turn in turns]


def _makers(
    body: RigidBody,
    potential: Potential,
    motion: PlanarMotion,
    bits: int,
    methods: Sequence[EnclosureMethod],
    find_arc: FindArc | None,
) -> list[tuple[EnclosureMethod, Callable[[], _Motion | None]]]:
    """Return what makes the motion by each of the methods; None from the first leaves it to the next."""
    sign = motion.g3_sign if body.A < body.C else motion.sign_of_g1
    terms = recognise(body, potential, sign) if "elliptic" in methods else None
    makers: dict[EnclosureMethod, Callable[[], _Motion | None]] = {
        "integral": partial(motion_by_integral, body, potential, motion, bits, find_arc)
    }
    if terms is not None:
        makers["elliptic"] = partial(elliptic_motion, body, terms, motion)
    return [(method, makers[method]) for method in methods if method in makers]


def _conventions(body: RigidBody, potential: Potential, motion: PlanarMotion) -> tuple[str, ...]:
    return () if make_loop(body, potential, motion).is_smooth_at_poles() else (SYMMETRIC_POLE_PASSAGE,)


def _numbers(result: Certified) -> list[arb]:
    period = [] if result.period is None else [result.period]
    return [*period, result.energy, *(value for state in result.states for value in state)]


def _widest(result: Certified) -> float:
    return largest(float(value.rad()) for value in _numbers(result))


def _is_narrow(result: Certified) -> bool:
    allowed = arb(2) ** (ALLOWED_BITS - result.bits)
    if result.period is not None and not result.period.rad() <= allowed * abs(result.period).lower():
        return False
    return all(is_narrow(value, result.bits) for value in _numbers(result))


def is_narrow(value: arb, bits: int) -> bool:
    """Say whether a ball is as narrow as ``bits`` ask for."""
    allowed = arb(2) ** (ALLOWED_BITS - bits)
    return bool(value.rad() <= allowed or value.rad() <= allowed * abs(value).lower())
