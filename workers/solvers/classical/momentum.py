"""The motions of Hess beyond integrators: the momentum by its length and its angle.

The length is a quadrature, the angle has one equation of its own.

The angle φ of the momentum in the circular section tends to a periodic motion, forwards and backwards in
time: errors of it die out. An integration of the six equations leaves the case exponentially instead.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, cos, hypot, sqrt
from typing import TYPE_CHECKING

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.classical.cases.hess import angle_rate
from service.dynamics.classical.loop import BITS
from service.dynamics.classical.placed import Placed, ball
from service.dynamics.classical.reduced import value
from workers.solvers.classical.clock import Clock
from workers.solvers.classical.curve import LoopInDoubles
from workers.solvers.errors import PrecisionLostError

if TYPE_CHECKING:
    from scipy.integrate import DenseOutput, OdeSolution

FloatArray = NDArray[np.float64]
Slope = Callable[[float, FloatArray], FloatArray]

TOLERANCE = 3e-14
"""Local, of the angle: the least that SciPy takes."""
LONGEST = 0.125
"""Step, in θ: the polynomials between the steps are of lower order than the steps."""
LONGER = 1.6
"""Times as long are the steps of the second run, whose difference shows the error of the first."""
SAFETY = 4.0
MOST_STEPS = 400_000


@dataclass(frozen=True, slots=True)
class Angle:
    """φ over the angle θ of the loop, on both sides of the start."""

    first: float
    backward: "OdeSolution | None"
    forward: "OdeSolution | None"

    def __call__(self, theta: FloatArray, start: float) -> FloatArray:
        """Return φ, shape (n,)."""
        found = np.full_like(theta, self.first)
        for side, chosen in ((self.forward, theta > start), (self.backward, theta < start)):
            if side is not None and chosen.any():
                found[chosen] = side(theta[chosen])[0]
        return found


@dataclass(frozen=True, slots=True)
class Momentum:
    """A motion of Hess as a function of time, in doubles, over a span of times."""

    placed: Placed
    loop: LoopInDoubles
    clock: Clock
    start: float
    """θ at time 0."""
    since: float
    """Time from θ = 0 to the start."""
    angle: Angle
    constants: dict[str, float]

    @classmethod
    def of(cls, placed: Placed, span: tuple[float, float], longest: float = LONGEST) -> "Momentum":
        """Compute the angle over ``span``."""
        assert placed.loop is not None
        clock = Clock.of(placed.loop, arb(1))
        loop = LoopInDoubles.of(placed.loop)
        with ctx.workprec(BITS):
            constants, start = _constants(placed)
            since = float(clock.time(start))
        ends = clock.angles(since + np.array(span))
        first = constants.pop("phi")

        def slope(theta: float, phi: FloatArray) -> FloatArray:
            return _slope(loop, constants, theta, phi)

        at = float(start)
        sides = [_follow(slope, at, first, float(end), longest) for end in ends]
        return cls(placed, loop, clock, at, since, Angle(first, sides[0], sides[1]), constants)

    def sample(self, times: FloatArray) -> FloatArray:
        """Return p, q, r, g1, g2, g3, shape (n, 6), at times within the span."""
        k = self.constants
        theta = self.clock.angles(self.since + times)
        phi, x = self.angle(theta, self.start), self.loop.x(theta)
        v = self.loop.factors(theta)[1]
        signed = k["areas"] == 0.0
        m = x if signed else np.sqrt(x)
        c, s, zero = np.cos(phi), np.sin(phi), 0.0 * phi
        ex, ez, G = k["ex"], k["ez"], k["G"]
        # e = (ex, 0, ez), f1 = (ez, 0, -ex), f2 = (0, 1, 0); the momentum is along M, and N = e × M.
        M, N = (c * ez, s, -c * ex), (-s * ez, c, s * ex)
        along = (k["h"] - m * m / (2.0 * k["B"])) / G
        on_M = zero if signed else k["areas"] / m
        on_N = v / G if signed else v / (G * m)
        gamma = [along * e + on_M * a + on_N * b for e, a, b in zip((ex, 0.0, ez), M, N, strict=True)]
        omega = [m * a / moment for a, moment in zip(M, (k["A"], k["B"], k["C"]), strict=True)]
        frame = self.placed.fitting.frame
        return np.stack([*frame.axial_back(omega), *frame.vector_back(gamma)], axis=1)


def error_of(placed: Placed, motion: Momentum, span: tuple[float, float]) -> float:
    """Return the difference to a second run of the angle with longer steps, with a factor of safety."""
    other = Momentum.of(placed, span, LONGER * LONGEST)
    times = np.linspace(*span, 1025)
    found = motion.sample(times)
    shared = 64.0 * float(np.spacing(np.abs(found).max()))
    start = np.array([float(x) for x in (*placed.start.omega, *placed.start.gamma)])
    at_start = float(np.abs(motion.sample(np.zeros(1))[0] - start).max())
    return SAFETY * max(float(np.abs(found - other.sample(times)).max()), at_start) + shared


def _constants(placed: Placed) -> tuple[dict[str, float], arb]:
    """Return the constants of a motion, φ at time 0 among them, and θ at time 0."""
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
    doubles = {name: float(number) for name, number in constants.items()}
    return {**doubles, "phi": atan2(float(M2), float(M1))}, arb.atan2(sine, cosine)


def _slope(loop: LoopInDoubles, k: dict[str, float], theta: float, phi: FloatArray) -> FloatArray:
    # Scalars of Python: of one angle arrays would take ten times as long.
    x = loop.middle - loop.half * cos(theta)
    rate = loop.reduced.rate * sqrt(value(loop.V, x))
    m = x if k["areas"] == 0.0 else sqrt(x)
    turned = 0.0 if k["areas"] == 0.0 else k["G"] * k["areas"] / x
    return np.array([(-k["k"] * m * cos(phi.item()) - turned) / rate])


def _follow(slope: Slope, start: float, first: float, end: float, longest: float) -> "OdeSolution | None":
    if hypot(end - start) == 0.0:
        return None
    # Not at the top: it takes long to load, and few motions need it.
    from scipy.integrate import DOP853, OdeSolution  # noqa: PLC0415

    solver = DOP853(slope, start, np.array([first]), end, rtol=TOLERANCE, atol=TOLERANCE, max_step=longest)
    angles, pieces = [start], list["DenseOutput"]()
    while solver.status == "running":
        solver.step()
        is_lost = angles[-1] == solver.t or len(pieces) > MOST_STEPS
        if is_lost:
            raise PrecisionLostError(f"the angle of the momentum cannot be followed beyond {solver.t:.6g}")
        angles.append(float(solver.t))
        pieces.append(solver.dense_output())
    return OdeSolution(angles, pieces)
