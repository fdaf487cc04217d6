"""Proves that a potential is not admissible: by a point with L(V) ≠ 0, or by a jump across a line x = 0."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from math import inf, isfinite, tan
from typing import Literal

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.equations.compatibility import along_curves, energy_on_curve, residual_ball
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.tape import Tape
from service.dynamics.verdict.proofs.on_lines import jumps_at
from service.dynamics.verdict.sphere.boxes import Boxes, Point, point_of_tangents
from service.dynamics.verdict.sphere.switches import Signs, Switches

_DIGITS = 20
"""Digits of the decimal midpoint; the rounding goes into the radius."""


@dataclass(frozen=True, slots=True)
class DecimalBall:
    """mid ± rad in decimals, rounded outwards: the exact number is certainly inside."""

    mid: str
    rad: str
    excludes_zero: bool


@dataclass(frozen=True, slots=True)
class Counterexample:
    """A point ``g``, exactly on the sphere, and the enclosure of L(V) there, which excludes zero."""

    g: Point
    residual: DecimalBall


@dataclass(frozen=True, slots=True)
class Survey:
    """The result of a search: a counterexample, or how closely zero was enclosed.

    ``defined`` are the points where V has finite enclosures; ``largest`` is
    the enclosure of greatest absolute value there, ``relative`` the greatest
    quotient of such a value by the size of the terms of L.
    """

    bits: int
    defined: tuple[Point, ...]
    counterexample: Counterexample | None
    largest: DecimalBall
    relative: float


def survey(
    body: RigidBody,
    tape: Tape,
    points: Iterable[Point],
    *,
    bits: int,
    is_late: Callable[[], bool] = lambda: False,
) -> Survey:
    """Enclose L(V) at the points with ``bits`` of precision, up to the first that refutes, or until late."""
    defined: list[Point] = []
    largest, relative = arb(0), 0.0
    with ctx.workprec(bits):
        for point in points:
            if is_late():
                break
            ball = residual_ball(body, tape, point)
            if not ball.is_defined:
                continue
            defined.append(point)
            if not ball.residual.contains(0):
                residual = decimal_ball(ball.residual)
                if residual.excludes_zero:
                    example = Counterexample(point, residual)
                    return Survey(bits, tuple(defined), example, residual, 1.0)
            bound = ball.residual.abs_upper()
            if bound > largest.abs_upper():
                largest = ball.residual
            if bound > 0:
                quotient = float((bound / ball.size).abs_upper())
                relative = max(relative, quotient if isfinite(quotient) else inf)
        return Survey(bits, tuple(defined), None, decimal_ball(largest), relative)


def decimal_ball(ball: arb) -> DecimalBall:
    """Return decimals that enclose the ball."""
    mid, rad, exponent = (int(part) for part in ball.mid_rad_10exp(_DIGITS))
    return DecimalBall(_decimal(mid, exponent), _decimal(rad, exponent), excludes_zero=abs(mid) > rad)


def decimal_point(g: tuple[arb, arb, arb]) -> tuple[tuple[str, str, str], str]:
    """Return decimals of a point, and a radius that holds for each of them."""
    first, second, third = (decimal_ball(each) for each in g)
    radius = max((each.rad for each in (first, second, third)), key=Fraction)
    return (first.mid, second.mid, third.mid), radius


def _decimal(mantissa: int, exponent: int) -> str:
    """Return mantissa · 10^exponent in the notation that exact numbers are read in."""
    if mantissa == 0:
        return "0"
    digits = str(abs(mantissa))
    stripped = digits.rstrip("0")
    sign = "-" if mantissa < 0 else ""
    tail = f".{stripped[1:]}" if len(stripped) > 1 else ""
    power = exponent + len(digits) - 1
    return f"{sign}{stripped[0]}{tail}e{power}" if power else f"{sign}{stripped[0]}{tail}"


_BITS = 192
_CROSSING_HALVINGS = 120
"""The crossing is known to 2^-120 of the box, its values to that times a slope."""
_PLACES = (Fraction(1, 3), Fraction(5, 8), Fraction(1, 50), Fraction(49, 50))


@dataclass(frozen=True, slots=True)
class Jump:
    """V or H differ by ``jump`` on the two sides of a line, at a point of it.

    ``g`` is the point, each of its coordinates within ``radius``.
    """

    of: Literal["potential", "energy"]
    g: tuple[str, str, str]
    radius: str
    jump: DecimalBall


def find_jump(
    body: RigidBody, switches: Switches, switch: int, sides: tuple[Signs, Signs], box: tuple[Boxes, int]
) -> Jump | None:
    """Look for a crossing in a box where V or H certainly jumps. ``sides``: above and below the line."""
    argument = switches.argument(switch)
    above, below = (switches.on_piece(signs) for signs in sides)
    signs = box[0].octant[box[1]]
    octant = (int(signs[0]), int(signs[1]), int(signs[2]))
    with ctx.workprec(_BITS):
        for along_theta in (True, False):
            for place in _PLACES:
                g = _crossing(argument, box, place, along_theta)
                if g is None:
                    continue
                found = _jump_at(body, switches, argument, above, below, sides, switch, octant, g)
                if found is not None:
                    return found
    return None


def _jump_at(
    body: RigidBody,
    switches: Switches,
    argument: Tape,
    above: Tape,
    below: Tape,
    sides: tuple[Signs, Signs],
    switch: int,
    octant: tuple[int, int, int],
    g: tuple[arb, arb, arb],
) -> Jump | None:
    if not _separates(switches, switch, sides[0], g):
        return None
    balls = BallAlgebra()
    A, C = balls.constant(body.A), balls.constant(body.C)
    _, slopes = _with_gradient(argument, g)
    if along_curves(A, C, g, slopes).contains(0):
        return None
    values = [_with_gradient(tape, g) for tape in (above, below)]
    potential = values[0][0] - values[1][0]
    first, second = (energy_on_curve(A, C, g, V, gradient) for V, gradient in values)
    energy = first - second
    if not (potential.is_finite() and energy.is_finite()):
        potential, energy = jumps_at(body, above, below, octant, g)
    for name, ball in (("potential", potential), ("energy", energy)):
        if ball.is_finite() and not ball.contains(0):
            jump = decimal_ball(ball)
            if jump.excludes_zero:
                return Jump("energy" if name == "energy" else "potential", *decimal_point(g), jump)
    return None


def _separates(switches: Switches, switch: int, signs: Signs, g: tuple[arb, arb, arb]) -> bool:
    """Whether the other switches have their signs there, and V may have a value on both sides."""
    registers: list[arb] = list(g)
    for instruction in switches.tape.instructions:
        single = Tape(tuple(map(str, range(len(registers)))), (instruction,), len(registers))
        registers.append(single.evaluate(BallAlgebra(), registers))
    others = all(
        registers[register] * signs[number] > 0
        for number, register in enumerate(switches.absolutes)
        if number != switch
    )
    return others and all(not registers[register] <= 0 for register in switches.positives)


def _crossing(
    argument: Tape, box: tuple[Boxes, int], place: Fraction, along_theta: bool
) -> tuple[arb, arb, arb] | None:
    """Return a ball about a zero of x on a segment of a box, None if its ends have the same sign."""
    boxes, index = box
    signs = boxes.octant[index]
    octant = (int(signs[0]), int(signs[1]), int(signs[2]))
    thetas = [Fraction(tan(0.5 * float(each[index]))) for each in (boxes.theta_low, boxes.theta_high)]
    phis = [Fraction(tan(0.5 * float(each[index]))) for each in (boxes.phi_low, boxes.phi_high)]
    moving, still = (thetas, phis) if along_theta else (phis, thetas)
    fixed = still[0] + place * (still[1] - still[0])

    def point(moved: Fraction) -> Point:
        t, u = (moved, fixed) if along_theta else (fixed, moved)
        return point_of_tangents(octant, t, u)

    return _bisected(argument, point, moving[0], moving[1])


def _bisected(
    argument: Tape, point: Callable[[Fraction], Point], low: Fraction, high: Fraction
) -> tuple[arb, arb, arb] | None:
    first, last = _value(argument, point(low)), _value(argument, point(high))
    for end, value in ((low, first), (high, last)):
        if value.is_zero():
            return _enclosure(point(end), point(end))
    if not ((first > 0 and last < 0) or (first < 0 and last > 0)):
        return None
    rises = bool(first < 0)
    for _ in range(_CROSSING_HALVINGS):
        middle = (low + high) / 2
        value = _value(argument, point(middle))
        if value.contains(0):
            break
        if (value < 0) == rises:
            low = middle
        else:
            high = middle
    return _enclosure(point(low), point(high))


def _enclosure(one: Point, other: Point) -> tuple[arb, arb, arb]:
    """Return a ball about two points, with all between them."""
    balls = BallAlgebra()
    g1, g2, g3 = (balls.constant(x).union(balls.constant(y)) for x, y in zip(one, other, strict=True))
    return g1, g2, g3


def _value(tape: Tape, point: Point) -> arb:
    balls = BallAlgebra()
    return tape.evaluate(balls, [balls.constant(coordinate) for coordinate in point])


def _with_gradient(tape: Tape, g: tuple[arb, arb, arb]) -> tuple[arb, tuple[arb, arb, arb]]:
    jets = FirstOrderJets(BallAlgebra(), 3)
    jet = tape.evaluate(jets, jets.variables(g))
    V_1, V_2, V_3 = jets.gradient(jet)
    return jet.value, (V_1, V_2, V_3)
