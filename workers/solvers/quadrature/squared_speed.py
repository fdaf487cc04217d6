r"""Bounds (dθ/dt)² about a stretch of phases, and proves that it is holomorphic there.

The inverse square of the rate dt/dθ is the simple part of it: for the phases of
:mod:`workers.solvers.orbits.orbit` and :mod:`.flight` it is c² P times elementary functions. It has no root
and no quotient by P, so it is holomorphic wherever the potential is, beyond the zeros of P too, and a bound
from above is all that is needed of it (:mod:`.panel`).

V is replaced, stretch by stretch of a motion, by formulas that are easier to bound:

* Where the argument of |x| has one sign on a stretch, V is there the same as with x or −x in its place, and
  that formula goes on analytically beyond the stretch. A panel that ends at a kink is then proved on as
  large an ellipse as any other; without it, panels would shrink to the kink from both sides.
* Where x > 0, a/(b + exp x) is a exp(−x)/(b exp(−x) + 1). Both are the same function; but in complex
  balls a large exp x has any phase, and b + exp x may then be 0 for all they know.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise

from flint import arb, ctx

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.rewriting import copied, exponential_in, with_sides
from service.dynamics.formula.tape import Instruction, Recorder, Tape, without_unused
from service.dynamics.potentials.potential import NoClosedFormError
from workers.solvers.assembly.dense import TimeMap
from workers.solvers.orbits.orbit import Libration, Rotation
from workers.solvers.quadrature.flight import Flight
from workers.solvers.quadrature.panel import BranchedSpeed, PhaseSpeed
from workers.solvers.quadrature.speeds import (
    FlightSpeed,
    LibrationSpeed,
    RotationSpeed,
    Speed,
    complex_radicand,
)
from workers.solvers.quadrature.time_map import make_time_map

KINK_MAX_WIDTH_U = 1e-15
"""Width in u of a stretch that holds a kink: a few roundings of u."""
MAX_KINK_STRETCHES = 3000
"""Beyond which kinks are not looked for: they are in too many places."""

EXP_AS_GIVEN_MAX_X = 4.0
"""|x| up to which exp(x) is as good as exp(−x)."""

Places = Callable[[float, float], tuple[arb, arb, arb] | None]
"""Returns an enclosure of g1, g2, g3 on a stretch of u; None if there is none."""


@dataclass(frozen=True, slots=True)
class Branch:
    """V on a stretch of the way."""

    left: float
    right: float
    tape: Tape
    is_kink: bool
    """The stretch is as narrow as the roundings of u, and holds a kink."""


def branches(tape: Tape, places: Places, corners: Sequence[float], end: float) -> tuple[Branch, ...]:
    """Return V on stretches that cover 0 ≤ u ≤ ``end``; one that is V itself where no kink is found."""
    plain = with_absolute_values(tape)
    inside = _arguments(plain)
    whole = (Branch(0.0, end, tape, is_kink=False),)
    if not inside:
        return whole
    builder, registers = copied(plain)
    arguments = [_Argument(builder.tape(registers[x]), is_exponent) for x, is_exponent in inside]
    cuts = sorted({0.0, end, *(corner for corner in corners if 0.0 < corner < end)})
    found = _stretches(arguments, places, list(pairwise(cuts)))
    if found is None:
        return whole
    made = []
    for left, right, signs in found:
        known = list(zip(inside, signs, strict=True))
        growing = {x for (x, is_exponent), sign in known if is_exponent and sign > 0}
        sided = {x: sign for (x, is_exponent), sign in known if sign and not is_exponent}
        is_kink = any(sign == 0 and not is_exponent for (_, is_exponent), sign in known)
        made.append(Branch(left, right, with_sides(plain, sided, growing), is_kink))
    return tuple(made)


def _arguments(tape: Tape) -> list[tuple[int, bool]]:
    """Return the registers x in |x|, and with True those in a/(b + exp x)."""
    inputs = len(tape.variables)
    found: dict[tuple[int, bool], None] = {}
    for made in tape.instructions:
        # The signs of g1 and g3 are known all along the way.
        if made.operation == "call" and made.name == "abs" and made.left >= inputs:
            found[made.left, False] = None
        if made.operation == "divide":
            split = exponential_in(tape, made.right)
            if split is not None:
                found[split[0], True] = None
    return list(found)


def with_absolute_values(tape: Tape) -> Tape:
    """Return the tape with |x|^(k e) for every (x^k)^e, k even and e a fraction: the same for real x."""
    inputs = len(tape.variables)
    recorder = Recorder(tape.variables)
    registers = {register: register for register in range(-1, inputs)}
    for register, made in enumerate(tape.instructions, start=inputs):
        base = tape.instructions[made.left - inputs] if made.left >= inputs else None
        exponent = _even_inside(made, base)
        if exponent is None or base is None:
            left, right = registers[made.left], registers[made.right]
            registers[register] = recorder.emit(made._replace(left=left, right=right))
        else:
            size = recorder.emit(Instruction("call", registers[base.left], name="abs"))
            is_one = exponent == 1
            registers[register] = (
                size if is_one else recorder.emit(Instruction("power", size, number=exponent))
            )
    return without_unused(recorder.whole(registers[tape.result]))


def _even_inside(made: Instruction, base: Instruction | None) -> Fraction | None:
    """Return k e for (x^k)^e, None for another instruction."""
    if made.operation != "power" or made.number is None or made.number.denominator == 1 or base is None:
        return None
    if base.operation == "multiply" and base.left == base.right:
        return 2 * made.number
    if base.operation == "power" and base.number is not None:
        is_even = base.number.denominator == 1 and base.number.numerator % 2 == 0
        return base.number * made.number if is_even else None
    return None


_Stretch = tuple[float, float, tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class _Argument:
    tape: Tape
    is_exponent: bool

    def side(self, gamma: tuple[arb, arb, arb], *, is_last: bool) -> int | None:
        """Return the sign on a stretch, 0 at a kink; None if a shorter one has to be asked."""
        value = self.tape.evaluate(BallAlgebra(), gamma)
        if value > 0 or value < 0:
            return 1 if value > 0 else -1
        return 0 if is_last or (self.is_exponent and abs(value) < EXP_AS_GIVEN_MAX_X) else None


def _stretches(
    arguments: Sequence[_Argument], places: Places, first: Sequence[tuple[float, float]]
) -> list[_Stretch] | None:
    """Return stretches in order, neighbours with the same signs joined."""
    pending = list(first)[::-1]
    done: list[_Stretch] = []
    for _ in range(MAX_KINK_STRETCHES):
        if not pending:
            return done
        left, right = pending.pop()
        is_last, gamma = right - left < KINK_MAX_WIDTH_U, places(left, right)
        if gamma is None:
            sides: list[int | None] = [0 if is_last else None] * len(arguments)
        else:
            sides = [argument.side(gamma, is_last=is_last) for argument in arguments]
        signs = tuple(side for side in sides if side is not None)
        if len(signs) == len(sides):
            if done and done[-1][2] == signs:
                left = done.pop()[0]
            done.append((left, right, signs))
        else:
            middle = 0.5 * (left + right)
            pending += [(middle, right), (left, middle)]
    return None


CACHED_TIME_MAPS = 4
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


@lru_cache(maxsize=CACHED_TIME_MAPS)
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
    return BranchedSpeed(
        tuple((branch.left, branch.right, along(branch.tape)) for branch in found),
        tuple((branch.left, branch.right) for branch in found if branch.is_kink),
    )


def _poles(orbit: Libration | Flight) -> list[int]:
    """Return the numbers v/π of the poles on the way."""
    lower, upper = (
        (orbit.lower, orbit.upper) if isinstance(orbit, Libration) else (orbit.arc.lower, orbit.arc.upper)
    )
    return [k for k in range(-4, 5) if lower < arb.pi() * k and arb.pi() * k < upper]
