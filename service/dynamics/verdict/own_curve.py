"""Proves or refuses a single planar motion of an undecided potential, on the motion's own arc.

For one motion L(V) = 0 is needed on its own arc only. The equation of q there is
B dq/dt = (C - A) r p + g3 V_1 - g1 V_3 = 2 (A - C) g1 g3 (h - H)/Q, with p and r from the energy h and
H = V + Q D/(2 (A - C) g1 g3); so q stays 0 if H is constant along the arc.

The arc is covered with cells on which g1, g2 and g3 are monotonic and keep their signs and the argument of
every absolute value of the formula has a certain sign, but for cells that may have a kink in them. On each
piece that the arc meets, X(H) = 0 is proved in the exact ring, everywhere or on the curve; at the kinks V
and H are proved the same on both sides. Nothing less is accepted: an enclosure of X(H) on a cell, however
small, leaves room for q ≠ 0.

With C/A = c/a in lowest terms the curve |g3| = λ |g1|^(C/A) is, in one octant, the zero of the polynomial
|g3|^a - λ^a |g1|^c. H is constant along it if X(H) is zero, or a multiple of that polynomial.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from math import nextafter
from typing import ClassVar

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.equations.compatibility import pde_residual
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.families.general_solution import GeneralPotential
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.window import Arc
from service.dynamics.verdict.exact_ring.generators import (
    Element,
    Layout,
    NoProofError,
    UndefinedInOctantError,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.piecewise import (
    Crossing,
    TooManyPiecesError,
    combinations,
    crossings_of,
    is_harmless,
    is_joined,
)
from service.dynamics.verdict.proofs.on_lines import is_multiple
from service.dynamics.verdict.proofs.proof import Signs as Octant
from service.dynamics.verdict.proofs.proof import prove
from service.dynamics.verdict.refutations import DecimalBall, decimal_ball, decimal_point
from service.dynamics.verdict.ring_functions.ring_algebra import (
    RingAlgebra,
    VectorFields,
    in_large_enough_ring,
)
from service.dynamics.verdict.sphere.boxes import DomainIntervals, bounds_of
from service.dynamics.verdict.sphere.switches import Signs, Switches, find_switches

FloatArray = NDArray[np.float64]

Axes = tuple[arb, arb, arb]

CELLS_PER_QUARTER = 16
"""Cells of a quarter of the loop to begin with."""
SLIVER_WIDTH = 2.0**-80
"""An arc may end beside a multiple of π/2 as close as this: the cell on the other side has that end in it."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A stretch lower ≤ v ≤ upper inside one quarter of the loop, and what g1, g2, g3 are at its ends.

    The axes are those of the client, not the primed ones of the loop.
    """

    loop: Loop
    lower: arb
    upper: arb
    at_lower: Axes
    at_upper: Axes

    @property
    def g(self) -> Axes:
        """Return balls of g1, g2 and g3 all over the cell: they are monotonic in it."""
        g1, g2, g3 = (x.union(y) for x, y in zip(self.at_lower, self.at_upper, strict=True))
        return g1, g2, g3

    @property
    def middle(self) -> arb:
        """Return an exact v in the middle."""
        return ((self.lower + self.upper) / 2).mid()

    @property
    def octant(self) -> tuple[int, int, int]:
        """Return the signs of g1, g2, g3 inside."""
        first, second, third = (1 if each > 0 else -1 for each in place_on(self.loop, self.middle))
        return first, second, third

    def halves(self) -> tuple["Cell", "Cell"]:
        """Return both halves."""
        middle = self.middle
        there = place_on(self.loop, middle)
        return replace(self, upper=middle, at_upper=there), replace(self, lower=middle, at_lower=there)


def cells_of(arc: Arc) -> Iterator[Cell]:
    """Yield cells that cover the arc."""
    quarter = arb.pi() / 2
    # An arc lies within -2π ≤ v ≤ 2π.
    for number in range(-4, 4):
        low, high = quarter * number, quarter * (number + 1)
        starts_inside, ends_inside = arc.lower > low, arc.upper < high
        lower, upper = (arc.lower if starts_inside else low), (arc.upper if ends_inside else high)
        if not upper - lower > SLIVER_WIDTH:
            continue
        places = [
            lower + (upper - lower) * ball(Fraction(k, CELLS_PER_QUARTER))
            for k in range(1, CELLS_PER_QUARTER)
        ]
        first = place_on(arc.loop, lower) if starts_inside else _corner(arc.loop, number)
        last = place_on(arc.loop, upper) if ends_inside else _corner(arc.loop, number + 1)
        points = [first, *(place_on(arc.loop, v) for v in places), last]
        edges = [lower, *places, upper]
        for k in range(CELLS_PER_QUARTER):
            yield Cell(arc.loop, edges[k], edges[k + 1], points[k], points[k + 1])


def place_on(loop: Loop, v: arb) -> Axes:
    """Return g1, g2, g3 at v, where neither sin v nor cos v is 0."""
    at = loop.point(v)
    return (at.g3, at.g2, at.g1) if loop.mirrored else (at.g1, at.g2, at.g3)


def _corner(loop: Loop, number: int) -> Axes:
    """Return g1, g2, g3 at v = number · π/2: a pole or a place on the equator."""
    first, second, third = arb(0), arb(0), arb(0)
    if number % 2:
        first, third = loop.G * loop.g1_sign, loop.Z if number % 4 == 1 else -loop.Z
    else:
        second = arb(1) if number % 4 == 0 else arb(-1)
    return (third, second, first) if loop.mirrored else (first, second, third)


MAX_RATIO_NUMERATOR = 64
"""Larger numerators of A/C make polynomials that are not divided by."""


@dataclass(frozen=True, slots=True)
class CurveOfMotion:
    """The curve of a motion: λ² and, where it is rational, λ."""

    body: RigidBody
    lambda_squared: Fraction
    lambda_: Fraction | None

    def polynomial(self, ring: Ring) -> Element | None:
        """Return the polynomial that is zero on the curve, None if it has no rational coefficients."""
        power = self.body.C / self.body.A
        a, c = power.denominator, power.numerator
        if max(a, c) > MAX_RATIO_NUMERATOR or (a % 2 and self.lambda_ is None):
            return None
        scale = self.lambda_squared ** (a // 2) * ((self.lambda_ or 1) if a % 2 else 1)
        first, _, third = ring.coordinate_index
        left = ring.monomial({third: a * ring.layout.degree("g3")})
        right = ring.monomial({first: c * ring.layout.degree("g1")})
        # With exponents in the numerator: what is divided by has to be a polynomial there.
        return ring.add(_raised(ring, left), _raised(ring, ring.multiply(ring.constant(-scale), right)))


def holds_on_piece(body: RigidBody, tape: Tape, octant: Octant, curve: CurveOfMotion) -> bool:
    """Whether H of a formula is proved constant along the curve in an octant."""

    def is_constant(ring: Ring, algebra: RingAlgebra) -> bool:
        fields = VectorFields(body, algebra, ring)
        V = tape.evaluate(algebra, [ring.coordinate(position) for position in range(3)])
        slope = ring.normal(fields.derivative("along", fields.H(V)))
        if slope.is_zero:
            return True
        polynomial = curve.polynomial(ring)
        return polynomial is not None and is_multiple(ring, slope, polynomial)

    try:
        return in_large_enough_ring(Layout(), octant, is_constant)[1]
    except (UndefinedInOctantError, NoProofError):
        return False


def _raised(ring: Ring, element: Element) -> Element:
    """Return a monomial with its exponents, none of them negative, in the numerator."""
    numerator = element.numerator
    for index, exponent in enumerate(element.shift):
        if exponent:
            numerator = numerator * ring.context.gen(index) ** exponent
    return ring.polynomial(numerator)


MAX_HALVINGS = 24
MAX_CELLS = 400
PRECISIONS = (192, 1024)
"""Bits of the enclosures of L(V) on the curve, by which a motion is refuted."""
POINTS_PER_CELL = 8


class InadmissibleMotionError(DynamicsError):
    """L(V) is certainly not 0 at a point of the motion's own curve: q does not stay 0."""

    code: ClassVar[str] = "inadmissible_motion"

    def __init__(self, g: tuple[str, str, str], radius: str, residual: DecimalBall) -> None:
        super().__init__(
            "the potential does not satisfy the compatibility equation on the curve of this motion, "
            "hence q does not stay 0; the residual at the point given is certainly not 0",
            pointer="/motion",
        )
        self.g = g
        self.radius = radius
        self.residual = residual


class UndecidedMotionError(DynamicsError):
    """L(V) = 0 is not proved on the motion's own curve."""

    code: ClassVar[str] = "undecided_motion"


def require_proof_on_arc(
    body: RigidBody, potential: Potential, motion: PlanarMotion, arc: Arc, is_late: Callable[[], bool]
) -> None:
    """Prove L(V) = 0 on the arc of a motion, at the current precision.

    Raises
    ------
    InadmissibleMotionError
        It is certainly not 0 at a point of the arc.
    UndecidedMotionError
        It is not proved.
    """
    if isinstance(potential, GeneralPotential):
        raise _undecided("V is given by an integral")
    cells = list(cells_of(arc))
    doubt = _doubt(body, find_switches(potential.tape), motion, cells, is_late)
    if doubt is None:
        return
    for bits in PRECISIONS:
        with ctx.workprec(bits):
            _refute(body, potential, arc, cells, is_late)
    raise _undecided(doubt)


def _undecided(doubt: str) -> UndecidedMotionError:
    return UndecidedMotionError(
        f"it is neither proved nor refuted that q = 0 on the curve of this motion: {doubt}", pointer="/motion"
    )


def _doubt(
    body: RigidBody,
    switches: Switches,
    motion: PlanarMotion,
    cells: list[Cell],
    is_late: Callable[[], bool],
) -> str | None:
    """Return what is not proved on the cells, None if all is."""
    try:
        met, crossings = _pieces_on(switches, cells, is_late)
    except TooManyPiecesError as error:
        return str(error)
    curve = CurveOfMotion(body, motion.lambda_squared, motion.lambda_)
    for octant, signs in sorted(met):
        piece = switches.on_piece(signs)
        if is_late() or not (holds_on_piece(body, piece, octant, curve) or prove(body, piece) is not None):
            return "the compatibility equation is not proved on a piece that the curve meets"
    for crossing in crossings:
        harmless = not is_late() and is_harmless(body, switches, crossing.switch)
        if not harmless and (is_late() or not is_joined(body, switches, crossing)):
            return "V and its energy are not proved the same on both sides of a kink that the curve crosses"
    return None


def _pieces_on(
    switches: Switches, cells: list[Cell], is_late: Callable[[], bool]
) -> tuple[set[tuple[Octant, Signs]], set[Crossing]]:
    """Return the pieces that the cells meet or may meet, and the kinks that they may cross."""
    met: set[tuple[Octant, Signs]] = set()
    crossings: set[Crossing] = set()
    for halving in range(MAX_HALVINGS + 1):
        if is_late():
            raise TooManyPiecesError("the time for a verdict is over")
        is_last = halving == MAX_HALVINGS or 2 * len(cells) > MAX_CELLS
        left: list[Cell] = []
        for cell, pattern in zip(cells, _patterns(switches, cells), strict=True):
            if 0 not in pattern:
                met.add((cell.octant, pattern))
            elif is_last:
                met |= {(cell.octant, each) for each in combinations(pattern)}
                crossings |= set(crossings_of(pattern))
            else:
                left.append(cell)
        if not left:
            break
        cells = [half for cell in left for half in cell.halves()]
    return met, crossings


def _patterns(switches: Switches, cells: list[Cell]) -> Iterator[Signs]:
    """Yield the sign of every absolute value's argument on each cell, 0 where both may be."""
    algebra = DomainIntervals(())
    axes = [algebra.interval(*_doubles([cell.g[position] for cell in cells])) for position in range(3)]
    low, high = bounds_of(algebra, axes, switches.tape, switches.absolutes, len(cells))
    signs = np.where(low > 0.0, 1, np.where(high < 0.0, -1, 0))
    for number in range(len(cells)):
        yield tuple(int(sign) for sign in signs[:, number])


def _doubles(balls: list[arb]) -> tuple[FloatArray, FloatArray]:
    """Return bounds of balls in doubles."""
    low = [nextafter(float(each.lower()), -2.0) for each in balls]
    high = [nextafter(float(each.upper()), 2.0) for each in balls]
    return np.array(low), np.array(high)


def _refute(
    body: RigidBody, potential: Potential, arc: Arc, cells: list[Cell], is_late: Callable[[], bool]
) -> None:
    """Raise InadmissibleMotionError if L(V) is certainly not 0 at one of some points in each cell."""
    loop, A, C = arc.loop.refined(), ball(body.A), ball(body.C)
    for cell, part in product(cells, range(POINTS_PER_CELL)):
        if is_late():
            return
        share = ball(Fraction(2 * part + 1, 2 * POINTS_PER_CELL))
        g = place_on(loop, (cell.lower + (cell.upper - cell.lower) * share).mid())
        V, gradient, hessian = potential.jet_ball(*g)
        residual = pde_residual(A, C, g, gradient, hessian)
        if V.is_finite() and residual.is_finite() and not residual.contains(0):
            found = decimal_ball(residual)
            if found.excludes_zero:
                raise InadmissibleMotionError(*decimal_point(g), found)
