r"""Time as a function of the phase: polynomials with a proven remainder, and their inverse.

On a disc |θ − θ_k| ≤ 2ρ covered by balls dt/dθ is proven holomorphic and bounded
by M. Its Taylor series in y = (θ − θ_k)/ρ then has coefficients |c_j| ≤ M 2^-j,
and those that the discrete Fourier transform takes from n values at |y| = 1
differ from c_j by c_{j+n} + c_{j+2n} + …; for |y| ≤ 1 both omissions together
are at most

.. math:: \sum_{j<n} \frac{M\,2^{-j-n}}{1-2^{-n}} + \sum_{j\ge n} M\,2^{-j} < 5 M\,2^{-n} .

θ(t) is enclosed by a step of the interval Newton method from an approximation.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import hypot, pi

from flint import acb, arb, arb_poly, ctx

from workers.solvers.certified.cover import Box, bound
from workers.solvers.certified.errors import CertifiedUnavailableError, PrecisionNeededError
from workers.solvers.certified.phase import MotionPhase

SLACK = 1.0625
"""ρ in half lengths of a piece: pieces overlap, so that a ball at an edge is inside one of them."""
FIRST_PIECES = 4
"""For half a turn."""
MAX_PIECES = 600
SHORTEST = 2.0**-36
"""Of a piece: its ends are doubles."""
MAX_BOXES = 24
SMALLEST_BOX = 0.2
"""Half the side of a box, in radii of the disc."""
NEWTON_STEPS = 60


@dataclass(frozen=True, slots=True)
class TimePiece:
    """dt/dθ and t for |θ − centre| ≤ radius, as polynomials in y = (θ − centre)/radius."""

    centre: arb
    radius: arb
    slope: arb_poly
    """dt/dy."""
    time: arb_poly

    def time_at(self, theta: arb) -> arb:
        """Return t."""
        return self.time(self.place(theta))

    def place(self, theta: arb) -> arb:
        """Return y; raises PrecisionNeededError unless |y| ≤ 1."""
        y = (theta - self.centre) / self.radius
        if not abs(y) <= 1:
            raise PrecisionNeededError("a phase outside its piece")
        return y

    def phase_at(self, t: arb) -> arb:
        """Return the enclosure of θ where the time is ``t``."""
        y = self._approximation(t)
        late = self.time(y) - t
        radius = 2 * (late / self.slope(y)).abs_upper() + arb(2) ** -ctx.prec
        for _ in range(4):
            guess = arb(y, radius.abs_upper())
            found = y - late / self.slope(guess)
            if abs(guess) <= 1 and guess.contains(found):
                return self.centre + self.radius * found
            radius = 8 * radius
        raise PrecisionNeededError("the inverse of time")

    def _approximation(self, t: arb) -> arb:
        """Return y to about the current precision, by Newton's method from the chord."""
        lowest, highest = self.time(arb(-1)).mid(), self.time(arb(1)).mid()
        y = (2 * (t - lowest) / (highest - lowest) - 1).mid()
        for _ in range(NEWTON_STEPS):
            step = ((self.time(y) - t) / self.slope(y)).mid()
            y = (y - step).mid()
            if not abs(y) <= 1:
                y = arb(1 if y > 0 else -1) * arb("0.999")
            elif abs(step) < arb(2) ** (-ctx.prec // 2 - 2):
                break
        return y


@dataclass(frozen=True, slots=True)
class TimeModel:
    """t(θ) over a turn, 0 at θ = 0, and θ(t)."""

    pieces: tuple[TimePiece, ...]
    starts: tuple[float, ...]
    """Times at which the pieces begin."""
    phases: tuple[float, ...]
    """Phases at which the pieces begin."""
    is_even: bool
    span: arb
    """Time of the whole turn, or of half of it if dt/dθ is even."""

    @property
    def period(self) -> arb:
        """Return the time of a turn."""
        return 2 * self.span if self.is_even else self.span

    def time_at(self, theta: arb) -> arb:
        """Return t for 0 ≤ θ ≤ 2π."""
        if self.is_even and theta.mid() > arb.pi():
            return self.period - self.time_at(2 * arb.pi() - theta)
        return self._piece(self.phases, theta).time_at(theta)

    def phases_at(self, times: Sequence[arb]) -> list[arb]:
        """Return θ at any times, up to whole turns."""
        return [self.phase_at(t) for t in times]

    def phase_at(self, t: arb) -> arb:
        """Return θ at any time ``t``, up to whole turns."""
        turns = (t / self.period).mid().floor().mid()
        t = t - turns * self.period
        if self.is_even and t.mid() > self.span.mid():
            return 2 * arb.pi() - self.phase_at(self.period - t)
        return self._piece(self.starts, t).phase_at(t)

    def _piece(self, begins: tuple[float, ...], value: arb) -> TimePiece:
        return self.pieces[max(0, bisect_right(begins, float(value)) - 1)]


def make_time_model(phase: MotionPhase) -> TimeModel:
    """Return the model at the current precision.

    Raises
    ------
    CertifiedUnavailableError
        dt/dθ is not enclosed on pieces of any size that is tried.
    """
    turn = pi if phase.is_even else 2.0 * pi
    count = FIRST_PIECES * (1 if phase.is_even else 2)
    waiting = [(turn * k / count, turn * (k + 1) / count) for k in reversed(range(count))]
    pieces: list[TimePiece] = []
    starts, phases = [], []
    t = arb(0)
    while waiting:
        left, right = waiting.pop()
        largest = _bound(phase, left, right)
        if largest is None:
            middle = 0.5 * (left + right)
            waiting += [(middle, right), (left, middle)]
            if len(waiting) + len(pieces) > MAX_PIECES or right - left < SHORTEST:
                raise CertifiedUnavailableError("no bound of its time as an analytic function was found")
            continue
        piece = _piece(phase, left, right, t, largest)
        pieces.append(piece)
        starts.append(float(t))
        phases.append(left)
        t = piece.time_at(arb(right))
    span = pieces[-1].time_at(arb.pi() if phase.is_even else 2 * arb.pi())
    return TimeModel(tuple(pieces), tuple(starts), tuple(phases), phase.is_even, span)


def _bound(phase: MotionPhase, left: float, right: float) -> arb | None:
    """Return M, the bound of |dt/dθ| on the disc of 2ρ, where it is holomorphic; None if not proven."""
    centre, reach = 0.5 * (left + right), SLACK * (right - left)
    half = 0.5 * reach
    # The lower half of the disc has the conjugate values.
    boxes = [Box(centre + half, half, half), Box(centre - half, half, half)]

    def meets_disc(box: Box) -> bool:
        return hypot(max(abs(box.x - centre) - box.half, 0.0), box.y - box.half) < 1.001 * reach

    return bound(phase, boxes, smallest=SMALLEST_BOX * reach, most=MAX_BOXES, is_needed=meets_disc)


def _piece(phase: MotionPhase, left: float, right: float, begin: arb, largest: arb) -> TimePiece:
    centre, radius = arb(0.5 * (left + right)), arb(SLACK * 0.5 * (right - left))
    size = abs(phase.rate(acb(centre), analytic=False)).upper()
    # Even, and such that 5 M 2^-n is a few ulp of the function.
    count = 2 * (1 + (ctx.prec + max(0, round(float((largest / size).log() / arb(2).log())))) // 2)
    upper = [phase.rate(centre + radius * y, analytic=False) for y in _circle(count, ctx.prec)]
    values = upper + [value.conjugate() for value in upper[-2:0:-1]]
    coefficients = [value.real / count for value in acb.dft(values)]
    remainder = arb(0, (5 * largest * arb(2) ** -count).abs_upper())
    coefficients[0] += remainder
    slope = arb_poly([radius * value for value in coefficients])
    time = slope.integral()
    time = time + (begin - time((arb(left) - centre) / radius))
    return TimePiece(centre, radius, slope, time)


@lru_cache(maxsize=64)
def _circle(count: int, precision: int) -> tuple[acb, ...]:
    """Return the count/2 + 1 roots of unity of the upper half plane, from 1 to −1."""
    with ctx.workprec(precision):
        return tuple(acb(arb(2 * j) / count).exp_pi_i() for j in range(count // 2 + 1))
