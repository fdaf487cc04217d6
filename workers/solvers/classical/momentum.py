r"""The motions of Hess beyond integrators: the momentum by its length and its angle.

The length is a quadrature; the angle φ of the momentum in the circular section has one equation of its own,
φ' = a cos φ + b, of Riccati. With φ = 2 arg(y1 + i y2) it is linear,

.. math:: y' = \frac12 \begin{pmatrix} 0 & a - b \\ a + b & 0 \end{pmatrix} y ,

and has the period of the loop: the propagators of its panels, by collocation at Chebyshev's points, serve
every turn. Their determinant is 1, so an error of φ at one time is multiplied by \|y\|² there over \|y\|²
later: this is how errors grow, or die out as φ tends to a periodic motion, forwards and backwards in time. An
integration of the six equations leaves the case exponentially instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, floor, hypot, log, pi, sin

import numpy as np
from flint import arb, ctx
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from service.dynamics.classical.cases.hess import angle_rate
from service.dynamics.classical.placement import Placed
from service.dynamics.classical.protocol import CASE_BITS, Number, value
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.numerics import largest
from service.dynamics.solution.dense_output import (
    EPSILON,
    TURN,
    TURN_LOW,
    chebyshev_coefficients,
    chebyshev_points,
)
from workers.solvers.assembly.dense import integration_matrix
from workers.solvers.classical.curve import CHECKED_POINTS, DIFFERENCE_FACTOR, Clock, LoopInDoubles
from workers.solvers.errors import PrecisionLostError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PANEL_DEGREE = 20
PANELS_PER_TURN = tuple(8 * 2**k for k in range(9))
"""Numbers of panels to a turn that are tried in turn until the propagators are resolved."""
TAIL_RELATIVE_SIZE = 1e-15
"""Largest tail of a propagator, relative to it."""
PROPAGATOR_ULPS = 2.0
"""Rounding of a propagator, in 2^-52 of it: of a and b, of the solution, of the product with those before."""
TIME_ROUNDINGS = 2.5
"""Roundings, in 2^-52 of a time: halves of its sum with the time of the start, of the mean time per radian,
of its product with the angle, of the sum of the series of time, and of the angle."""
MAX_PANELS = 1_000_000
"""Largest number of panels of all turns that a motion is followed for."""


@dataclass(frozen=True, slots=True)
class Angle:
    """The direction of y over the angle θ of the loop."""

    propagators: FloatArray
    """Coefficients on each panel of a turn, shape (panels, PANEL_DEGREE + 1, 2, 2)."""
    before: FloatArray
    """Products of those of the panels before each, and of the whole turn, shape (panels + 1, 2, 2)."""
    first: int
    """The turn to which the first row of ``along`` belongs."""
    along: FloatArray
    """Unit vectors along y at the beginnings of the turns, shape (turns, 2)."""
    error: float
    """Bound of the error of φ, to first order, between the ends."""

    def __call__(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return cos φ and sin φ, shape (n,) each."""
        turn, panel, x = _place(theta, len(self.propagators))
        powers = chebyshev.chebvander(x, PANEL_DEGREE)
        y = (self.before[panel] @ self.along[turn - self.first][:, :, None])[:, :, 0]
        y1, y2 = np.einsum("nd,ndij,nj->in", powers, self.propagators[panel], y)
        square = y1 * y1 + y2 * y2
        return (y1 - y2) * (y1 + y2) / square, 2.0 * y1 * y2 / square


@dataclass(frozen=True, slots=True)
class Momentum:
    """A motion of Hess as a function of time, in doubles, over a span of times."""

    placed: Placed
    loop: LoopInDoubles
    clock: Clock
    lower: float
    """Least value of the coordinate."""
    since: float
    """Time from θ = 0 to the start."""
    angle: Angle
    constants: dict[str, arb]
    doubles: dict[str, float]
    """The same, rounded."""

    @classmethod
    def of(cls, placed: Placed, span: tuple[float, float]) -> "Momentum":
        """Compute the angle over ``span``.

        Raises
        ------
        PrecisionLostError
            The angle is not resolved, or turns too often.
        """
        assert placed.loop is not None
        clock, loop, lower = (
            Clock.of(placed.loop, arb(1)),
            LoopInDoubles.of(placed.loop),
            float(placed.loop.lower),
        )
        with ctx.workprec(CASE_BITS):
            constants, phi, start = _constants(placed)
            since = float(clock.time(start))
        doubles = {name: float(number) for name, number in constants.items()}
        ends = clock.angles(since + np.array(span))
        angle = _follow(loop, lower, doubles, float(start), phi, ends.tolist())
        return cls(placed, loop, clock, lower, since, angle, constants, doubles)

    def time_error(self, latest: float) -> float:
        """Return the bound of what roundings make of a time up to ``latest`` where its angle is found."""
        turn = TURN * float(self.clock.mean)
        return EPSILON * (TIME_ROUNDINGS * latest + turn)

    def sample(self, times: FloatArray) -> FloatArray:
        """Return p, q, r, g1, g2, g3, shape (n, 6), at times within the span."""
        theta = self.clock.angles(self.since + times)
        x, v = _coordinate(self.loop, self.lower, theta), self.loop.factors(theta)[1]
        m = x if self.doubles["areas"] == 0.0 else np.sqrt(x)
        omega, gamma = _state(self.doubles, m, v, *self.angle(theta))
        frame = self.placed.fitting.frame
        return np.stack([*frame.axial_back(omega), *frame.vector_back(gamma)], axis=1)

    def error(self) -> float:
        """Return the bound of the error of a sample, beside that of its time.

        What errors of φ do, and what samples differ by from balls all over the loop, and at the start.
        """
        assert self.placed.loop is not None
        loop, k = self.placed.loop, self.constants
        cosine, sine = 0.6, 0.8
        apart = list[float]()
        with ctx.workprec(CASE_BITS):
            for index in range(CHECKED_POINTS):
                theta = TURN * index / CHECKED_POINTS
                x, (_, v) = loop.x(arb(theta)), loop.factors(arb(theta))
                m = x if k["areas"] == 0 else x.sqrt()
                exact = [float(each) for part in _state(k, m, v, arb(cosine), arb(sine)) for each in part]
                at, along = (
                    _coordinate(self.loop, self.lower, np.array(theta)),
                    self.loop.factors(np.array(theta)),
                )
                known = at if self.doubles["areas"] == 0.0 else np.sqrt(at)
                found = [
                    each for part in _state(self.doubles, known, along[1], cosine, sine) for each in part
                ]
                apart.append(float(np.abs(np.array(found) - exact).max()))
        start = np.array([float(x) for x in (*self.placed.start.omega, *self.placed.start.gamma)])
        apart.append(float(np.abs(self.sample(np.zeros(1))[0] - start).max()))
        longest = self.lower + 2.0 * self.loop.half
        longest = max(abs(self.lower), longest) if self.doubles["areas"] == 0.0 else longest**0.5
        fastest = longest / min(self.doubles[name] for name in "ABC")
        # What is seen at some places has its factor; the error of φ is a bound that has its own.
        return DIFFERENCE_FACTOR * largest(apart) + self.angle.error * max(1.0, fastest)


def _state(
    k: dict[str, Number], m: Number, v: Number, c: Number, s: Number
) -> tuple[list[Number], list[Number]]:
    """Return ω and γ in the axes of the case, from the momentum m, v, and cos φ and sin φ."""
    ex, ez, G = k["ex"], k["ez"], k["G"]
    # e = (ex, 0, ez), f1 = (ez, 0, -ex), f2 = (0, 1, 0); the momentum is along M, and N = e × M.
    M, N = (c * ez, s, -(c * ex)), (-(s * ez), c, s * ex)
    along = (k["h"] - m * m / (2 * k["B"])) / G
    on_M = 0 * m if k["areas"] == 0 else k["areas"] / m
    on_N = v / G if k["areas"] == 0 else v / (G * m)
    gamma = [along * e + on_M * a + on_N * b for e, a, b in zip((ex, 0 * ex, ez), M, N, strict=True)]
    return [m * a / moment for a, moment in zip(M, (k["A"], k["B"], k["C"]), strict=True)], gamma


def _coordinate(loop: LoopInDoubles, lower: float, theta: FloatArray) -> FloatArray:
    """Return x; next to its least value nothing cancels."""
    x: FloatArray = lower + 2.0 * loop.half * np.sin(0.5 * theta) ** 2
    return x


def _constants(placed: Placed) -> tuple[dict[str, arb], float, arb]:
    """Return the constants of a motion, and φ and θ at time 0."""
    assert placed.loop is not None
    assert placed.reduced is not None
    frame = placed.fitting.frame
    A, B, C = (ball(moment) for moment in placed.fitting.moments)
    a, _, c = (ball(x) for x in frame.vector(placed.motion.centre))
    p, q, r = (ball(x) for x in frame.axial(placed.start.omega))
    g1, g2, g3 = (ball(x) for x in frame.vector(placed.start.gamma))
    G = (a * a + c * c).sqrt()
    ex, ez = a / G, c / G
    M1, M2 = A * p * ez - C * r * ex, B * q
    m = (M1 * M1 + M2 * M2).sqrt()
    across = (M1 * g2 - M2 * (ez * g1 - ex * g3)) * G
    # x' is twice this; of the coordinate m without areas it is m times m'.
    has_areas = len(placed.reduced.V) == 4
    loop = placed.loop
    x = m * m if has_areas else m
    half, middle = (loop.upper - loop.lower) / 2, (loop.upper + loop.lower) / 2
    v = across if has_areas else across / m
    cosine = (middle - x) / half
    sine = v / (half * value(loop.V, x).sqrt())
    constants = {"A": A, "B": B, "C": C, "G": G, "ex": ex, "ez": ez, "k": angle_rate(A, C, a, c)}
    constants["h"] = (A * p * p + B * q * q + C * r * r) / 2 + a * g1 + c * g3
    constants["areas"] = A * p * g1 + B * q * g2 + C * r * g3 if has_areas else arb(0)
    return constants, atan2(float(M2), float(M1)), arb.atan2(sine, cosine)


def _follow(
    loop: LoopInDoubles, lower: float, k: dict[str, float], start: float, phi: float, ends: Sequence[float]
) -> Angle:
    """Return the angle with φ = ``phi`` at θ = ``start``, between the two ``ends``."""
    propagators, tail = _propagators(loop, lower, k)
    count = len(propagators)
    products = [np.eye(2)]
    for step in propagators.sum(axis=1):
        products.append(step @ products[-1])
    before = np.array(products)
    (home,), (panel,), x = _place(np.array([start]), count)
    inside = (
        np.einsum("d,dij->ij", chebyshev.chebvander(x, PANEL_DEGREE)[0], propagators[panel]) @ before[panel]
    )
    y = _inverse(inside) @ [cos(0.5 * phi), sin(0.5 * phi)]
    first, last = floor(min(*ends, start) / TURN), floor(max(*ends, start) / TURN)
    if (last - first) * count > MAX_PANELS:
        raise PrecisionLostError(f"the angle of the momentum is followed on {MAX_PANELS} panels at most")
    # One more on both sides, for angles that rounding takes there.
    ahead, behind = (
        _turned(y, before[-1], last - home + 2),
        _turned(y, _inverse(before[-1]), home - first + 1),
    )
    along, sizes = zip(*behind[:0:-1], *ahead, strict=True)
    directions = np.array(along)
    vectors = np.linalg.norm(before[:-1] @ directions[:, None, :, None], axis=2)[:, :, 0]
    logarithms = 2.0 * (np.array(sizes)[:, None] + np.log(vectors)).ravel()
    rounding = PROPAGATOR_ULPS * EPSILON
    norms = np.linalg.norm(before[:-1], axis=(1, 2))
    # The ends of panels before the start and behind it, as far as the motion goes.
    turns, panels, _ = _place(np.array([min(*ends, start), start, max(*ends, start)]), count)
    low, at, high = (turns - (first - 1)) * count + panels
    growth = largest(map(_accumulated, (logarithms[at : high + 2], logarithms[low : at + 2][::-1])))
    widest = float((np.linalg.norm(propagators.sum(axis=1), 2, axis=(1, 2)) ** 2).max())
    in_turn = float((norms / vectors)[turns[0] - first + 1 : turns[2] - first + 2].max())
    error = 2.0 * ((2.0 * tail + rounding) * widest * growth + rounding * in_turn)
    return Angle(propagators, before, first - 1, directions, error)


def _propagators(loop: LoopInDoubles, lower: float, k: dict[str, float]) -> tuple[FloatArray, float]:
    """Return the propagators of the panels of a turn, resolved, and their largest relative tail."""
    points = chebyshev_points(PANEL_DEGREE)
    interpolation = chebyshev_coefficients(np.eye(PANEL_DEGREE + 1))
    integration = integration_matrix(PANEL_DEGREE)
    size = 2 * (PANEL_DEGREE + 1)
    tail = np.inf
    for count in PANELS_PER_TURN:
        half = pi / count
        theta = half * (2.0 * np.arange(count)[:, None] + 1.0 + points)
        x = _coordinate(loop, lower, theta)
        rate = loop.reduced.rate * np.sqrt(value(loop.V, x))
        signed = k["areas"] == 0.0
        a = -k["k"] * (x if signed else np.sqrt(x)) / rate
        b = 0.0 * x if signed else -k["G"] * k["areas"] / (x * rate)
        zero = 0.0 * x
        M = 0.5 * half * np.stack([np.stack([zero, a - b], -1), np.stack([a + b, zero], -1)], -2)
        blocks = integration[:, None, :, None] * M.transpose(0, 2, 1, 3)[:, None]
        equations = np.eye(size) - blocks.reshape(count, size, size)
        ones = np.broadcast_to(np.tile(np.eye(2), (PANEL_DEGREE + 1, 1)), (count, size, 2))
        inside = np.linalg.solve(equations, ones).reshape(count, PANEL_DEGREE + 1, 2, 2)
        series = np.einsum("dj,njab->ndab", interpolation, inside)
        tail = float((np.abs(series[:, -2:]).max(axis=(1, 2, 3)) / np.abs(inside).max(axis=(1, 2, 3))).max())
        if tail <= TAIL_RELATIVE_SIZE:
            return series, tail
    raise PrecisionLostError(f"{PANELS_PER_TURN[-1]} panels a turn do not resolve the angle of the momentum")


def _place(theta: FloatArray, count: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the turn of angles, their panel among ``count``, and their place in [-1, 1] on it."""
    turn = np.floor(theta / TURN)
    # 2π in two doubles: the turns are many, and their rest is no rounding.
    share = (np.fmod(theta, TURN) % TURN - turn * TURN_LOW) * (count / TURN)
    panel = np.clip(np.floor(share), 0, count - 1)
    return turn.astype(np.int64), panel.astype(np.int64), 2.0 * (share - panel) - 1.0


def _turned(y: FloatArray, turn: FloatArray, count: int) -> list[tuple[FloatArray, float]]:
    """Return the directions of y, turn y, turn² y, ..., each with the logarithm of its length."""
    found, size = list[tuple[FloatArray, float]](), 0.0
    for _ in range(count + 1):
        length = hypot(y[0], y[1])
        y, size = y / length, size + log(length)
        found.append((y, size))
        y = turn @ y
    return found


def _accumulated(logarithms: FloatArray) -> float:
    """Return what errors of size 1 at all ends before have grown to at most; |y|² is given by logarithms."""
    sums = np.logaddexp.accumulate(logarithms)
    return float(np.exp(np.max(sums - logarithms)))


def _inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverse of a matrix of determinant 1."""
    return np.array([[matrix[1, 1], -matrix[0, 1]], [-matrix[1, 0], matrix[0, 0]]])
