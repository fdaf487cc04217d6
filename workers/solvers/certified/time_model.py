r"""Time as a function of the phase: polynomials with a proven remainder, and their inverse.

On a disc |θ − θ_k| ≤ 2ρ covered by balls dt/dθ is proven holomorphic and bounded
by M. Its Taylor series in y = (θ − θ_k)/ρ then has coefficients |c_j| ≤ M 2^-j,
and those that the discrete Fourier transform takes from n values at |y| = 1
differ from c_j by c_{j+n} + c_{j+2n} + …; for |y| ≤ 1 both omissions together
are at most

.. math:: \sum_{j<n} \frac{M\,2^{-j-n}}{1-2^{-n}} + \sum_{j\ge n} M\,2^{-j} < 5 M\,2^{-n} .

θ(t) is enclosed by a step of the interval Newton method from an approximation.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, reduce
from itertools import pairwise
from math import hypot, pi
from typing import NamedTuple

import numpy as np
from flint import acb, arb, arb_poly, ctx
from numpy.typing import NDArray

from workers.solvers.certified.phase import PhaseStretch, SmoothPhase
from workers.solvers.certified.way import MotionPhase
from workers.solvers.errors import CertifiedUnavailableError, PrecisionNeededError

FloatArray = NDArray[np.float64]
MAX_OVERESTIMATE_RATIO = 2.0**30
"""A bound this much larger than the function costs so many bits of a remainder: then it is refined."""
BOX_OVERLAP = 1.0 + 2.0**-20
"""Boxes are so much larger: roundings of their centres leave no gap."""
PIECE_OVERLAP = 1.0625
"""ρ in half lengths of a piece: pieces overlap, so that a ball at an edge is inside one of them."""
PLACE_ROUNDING = 2.0**-50
"""More than the relative rounding of a place to a double."""
FIRST_PIECES = 4
"""For a phase that grows by π."""
MAX_PIECES = 600
MIN_PIECE_SHARE = 2.0**-44
"""Least length of a piece, relative to its stretch: its ends are doubles."""
MIN_CIRCLE_POINTS = 40
"""Places on the circle: the six variables, in doubles, are taken there too."""
MAX_BOXES = 24
MIN_BOX_SHARE_OF_RADIUS = 0.2
"""Half the side of a box, in radii of the disc."""
NEWTON_STEPS = 60
SHARES = (0.0, 1 / 16, 1 / 4, 1 / 2, 3 / 4, 15 / 16, 1.0)
"""Places of a stretch at which its rate is looked at."""
NO_BOUND = (
    "no bound of its time as an analytic function was found; accepted are draft, standard and high, which do "
    "without"
)


@dataclass(frozen=True, slots=True)
class TimePiece:
    """dt/dθ and t for |θ − centre| ≤ radius, as polynomials in y = (θ − centre)/radius."""

    begin: arb
    """θ where the piece begins: what its polynomials are before it is another function next to a pole."""
    end: arb
    start: arb
    """t where it begins."""
    centre: arb
    radius: arb
    slope: arb_poly
    """dt/dy."""
    time: arb_poly
    states: FloatArray
    """Coefficients of the six variables in doubles, shape (n, 6): what they leave out is not proved."""

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
        """Return the enclosure of the θ of the piece where the time is ``t``.

        Raises PrecisionNeededError where none is proved to be on the piece itself: next to a pole its
        polynomials may take the same time once more, on the other side.
        """
        y = self.approximation(t)
        late = self.time(y) - t
        radius = 2 * (late / self.slope(y)).abs_upper() + arb(2) ** -ctx.prec
        for _ in range(4):
            guess = arb(y, radius.abs_upper())
            found = y - late / self.slope(guess)
            if abs(guess) <= 1 and guess.contains(found):
                theta = self.centre + self.radius * found
                if theta >= self.begin and theta <= self.end:
                    return theta
            radius = 8 * radius
        raise PrecisionNeededError("the inverse of time")

    def approximation(self, t: arb) -> arb:
        """Return y on the piece to about the current precision, by Newton's method inside a bracket."""
        low, high = -arb(1) / PIECE_OVERLAP, arb(1) / PIECE_OVERLAP
        lowest, highest = self.time(low).mid(), self.time(high).mid()
        low, high = low.mid(), high.mid()
        y = (low + (high - low) * (t - lowest) / (highest - lowest)).mid()
        for _ in range(NEWTON_STEPS):
            if not (y >= low and y <= high):
                y = ((low + high) / 2).mid()
            late = self.time(y) - t
            low, high = (low, y) if late > 0 else (y, high) if late < 0 else (low, high)
            step = (late / self.slope(y)).mid()
            y = (y - step).mid()
            if abs(step) < arb(2) ** (-ctx.prec // 2 - 2):
                break
        return y.max(low).min(high)


@dataclass(frozen=True, slots=True)
class TimeModel:
    """t(θ) over a turn, 0 at θ = 0, and θ(t)."""

    pieces: tuple[TimePiece, ...]
    is_even: bool
    length: arb
    """θ at the end."""
    span: arb
    """The time there."""
    starts: tuple[float, ...] = field(init=False)
    """Times at which the pieces begin, about."""
    phases: tuple[float, ...] = field(init=False)
    """Phases at which the pieces begin, about."""

    def __post_init__(self) -> None:
        """Round to doubles what pieces are looked for by."""
        object.__setattr__(self, "starts", tuple(float(piece.start) for piece in self.pieces))
        object.__setattr__(self, "phases", tuple(float(piece.begin) for piece in self.pieces))

    @property
    def period(self) -> arb:
        """Return the time of a turn."""
        return 2 * self.span if self.is_even else self.span

    def time_at(self, theta: arb) -> arb:
        """Return t for θ from 0 to the end, and back to 0 where dt/dθ is even."""
        if self.is_even and theta.mid() > self.length.mid():
            return self.period - self.time_at(2 * self.length - theta)
        found = [
            piece.time_at(theta) for piece in self._pieces(self.phases, lambda piece: piece.begin, theta)
        ]
        return reduce(arb.union, found)

    def phases_at(self, times: Sequence[arb]) -> list[arb]:
        """Return θ at any times, up to whole turns."""
        return [self.phase_at(t) for t in times]

    def phase_at(self, t: arb) -> arb:
        """Return θ at any time ``t``, up to whole turns."""
        turns = (t / self.period).mid().floor().mid()
        t = t - turns * self.period
        if self.is_even and t.mid() > self.span.mid():
            return 2 * self.length - self.phase_at(self.period - t)
        pieces = self._pieces(self.starts, lambda piece: piece.start, t)
        try:
            if len(pieces) == 1:
                return pieces[0].phase_at(t)
        except PrecisionNeededError:
            pass
        return self._between(t, pieces[0])

    def _between(self, t: arb, piece: TimePiece) -> arb:
        """Return θ next to a pole, where dt/dθ may vanish: time grows with it all the same."""
        guess = (piece.centre + piece.radius * piece.approximation(t)).mid()
        off = arb(2) ** -ctx.prec
        while off < 1:
            low, high = (guess - off).mid(), (guess + off).mid()
            is_after = not low > 0 or self.time_at(low) < t
            if is_after and (not high < self.length or self.time_at(high) > t):
                return low.union(high)
            off = 2 * off
        raise PrecisionNeededError("the inverse of time")

    def _pieces(
        self, begins: tuple[float, ...], begin_of: Callable[[TimePiece], arb], value: arb
    ) -> list[TimePiece]:
        """Return the pieces on which a phase, or a time, may be, which is known no better than their ends."""
        last = len(self.pieces) - 1
        # Next to a pole many pieces may begin within the rounding of one double.
        low = float(value.lower()) * (1.0 - PLACE_ROUNDING)
        high = float(value.upper()) * (1.0 + PLACE_ROUNDING)
        first = max(0, bisect_left(begins, low) - 1)
        return [
            self.pieces[k]
            for k in range(first, max(first, min(last, bisect_right(begins, high))) + 1)
            if (k == 0 or not value < begin_of(self.pieces[k]))
            and (k == last or not value > begin_of(self.pieces[k + 1]))
        ]


def make_time_model(phase: MotionPhase, bits: int) -> TimeModel:
    """Return the model at the current precision; what series leave out is 2^-bits of them, or less.

    Raises
    ------
    CertifiedUnavailableError
        dt/dθ is not enclosed on pieces of any size that is tried.
    """
    pieces: list[TimePiece] = []
    t = arb(0)
    for stretch in phase.stretches:
        for left, right, size, largest in _cut(stretch, bits):
            if size is None:
                piece = _bounded_piece(stretch, left, right, t, largest)
            else:
                piece = _piece(stretch, left, right, t, size, largest, bits)
            pieces.append(piece)
            t = piece.time_at(right + stretch.shift)
            if len(pieces) > MAX_PIECES:
                raise CertifiedUnavailableError(NO_BOUND)
    return TimeModel(tuple(pieces), phase.is_even, phase.length, t)


def _cut(stretch: PhaseStretch, bits: int) -> Iterator[tuple[arb, arb, arb | None, arb]]:
    """Yield the ends of pieces of the stretch in order, about how large dt/dθ is there, and its bound M.

    Next to a pole where dt/dθ is not holomorphic the piece is so short that its time is next to nothing, its
    bound is one for real θ, and how large dt/dθ is is None.
    """
    first, last = float(stretch.first), float(stretch.last)

    def size_at(place: float) -> arb:
        return abs(stretch.phase.rate(acb(place), analytic=False)).upper()

    # Next to a pole dt/dθ may vanish, and what is next to nothing need not be known relative to itself. Where
    # A/C is next to 1 it is next to nothing on nearly all of the stretch.
    sizes = [size_at(first + (last - first) * share) for share in SHARES]
    least = max(size for size in sizes if size.is_finite()) / MAX_OVERESTIMATE_RATIO
    least_time = least * MAX_OVERESTIMATE_RATIO * (last - first) * arb(2) ** -bits
    count = max(1, round(FIRST_PIECES * (last - first) / pi))
    cuts = [first + (last - first) * k / count for k in range(count)] + [last]
    waiting = list(pairwise(cuts))[::-1]
    while waiting:
        left, right = waiting.pop()
        size = size_at(0.5 * (left + right)).max(least)
        largest = _bound(stretch.phase, left, right, size)
        if largest is None:
            is_at_pole = (left == first == 0.0) or (right == last == 0.0)
            bound = stretch.phase.largest_rate(left or right) if is_at_pole else None
            if bound is not None and bound * (right - left) < least_time:
                begin = stretch.first if left == first else arb(left)
                yield begin, stretch.last if right == last else arb(right), None, bound
                continue
            middle = 0.5 * (left + right)
            waiting += [(middle, right), (left, middle)]
            if len(waiting) > MAX_PIECES or right - left < MIN_PIECE_SHARE * (last - first):
                raise CertifiedUnavailableError(NO_BOUND)
            continue
        # The ends themselves need not be doubles.
        begin = stretch.first if left == first else arb(left)
        yield begin, stretch.last if right == last else arb(right), size, largest


class Box(NamedTuple):
    """The square of side 2 ``half`` about x + iy."""

    x: float
    y: float
    half: float

    def meets(self, centre: float, reach: float) -> bool:
        """Say whether it may meet the upper half of a disc."""
        return hypot(max(abs(self.x - centre) - self.half, 0.0), self.y - self.half) < 1.001 * reach


def _bound(phase: SmoothPhase, left: float, right: float, size: arb) -> arb | None:
    """Return M, the bound of |dt/dθ| on the disc of 2ρ, where it is holomorphic; None if not proven.

    The disc is covered by boxes. A box is halved both ways until its ball tells something: what is proven may
    take MAX_BOXES balls. About the largest rate is ``size``.
    """
    centre, reach = 0.5 * (left + right), PIECE_OVERLAP * (right - left)
    half = 0.5 * reach
    # The lower half of the disc has the conjugate values.
    waiting = [Box(centre + half, half, half), Box(centre - half, half, half)]
    largest = arb(0)
    for _ in range(MAX_BOXES):
        while waiting and not waiting[-1].meets(centre, reach):
            waiting.pop()
        if not waiting:
            return largest
        x, y, half = waiting.pop()
        ball = acb(arb(x, half * BOX_OVERLAP), arb(y, half * BOX_OVERLAP))
        value = abs(phase.rate(ball, analytic=True)).upper()
        if value < MAX_OVERESTIMATE_RATIO * size:
            largest = largest.max(value)
        elif half > MIN_BOX_SHARE_OF_RADIUS * reach:
            half *= 0.5
            waiting += [Box(x + i * half, y + j * half, half) for i in (-1, 1) for j in (-1, 1)]
        else:
            return None
    return None


def _piece(
    stretch: PhaseStretch, left: arb, right: arb, begin: arb, size: arb, largest: arb, bits: int
) -> TimePiece:
    phase = stretch.phase
    centre = ((left + right) / 2).mid()
    radius = (PIECE_OVERLAP * (right - left) / 2).mid()
    # Even, and such that 5 M 2^-n is a few 2^-bits of the function.
    excess = (largest / size).log() / arb(2).log() if largest > 0 else arb(0)
    count = max(MIN_CIRCLE_POINTS, 2 * (1 + (bits + round(float(excess.max(arb(-bits))))) // 2))
    upper = [phase.motion(centre + radius * y) for y in _circle(count, ctx.prec)]
    rates = [rate for rate, *_ in upper]
    values = rates + [value.conjugate() for value in rates[-2:0:-1]]
    coefficients = [value.real / count for value in acb.dft(values)]
    remainder = arb(0, (5 * largest * arb(2) ** -count).abs_upper())
    coefficients[0] += remainder
    slope = arb_poly([radius * value for value in coefficients])
    time = slope.integral()
    time = time + (begin - time((left - centre) / radius))
    states = np.array([[complex(value) for value in state] for _, *state in upper])
    states = np.fft.fft(np.concatenate([states, states[-2:0:-1].conj()]), axis=0).real / count
    ends = left + stretch.shift, right + stretch.shift
    return TimePiece(*ends, begin, centre + stretch.shift, radius, slope, time, states)


def _bounded_piece(stretch: PhaseStretch, left: arb, right: arb, begin: arb, largest: arb) -> TimePiece:
    """Return a piece of which no more is known than that dt/dθ is between 0 and a bound."""
    centre, radius = ((left + right) / 2).mid(), (PIECE_OVERLAP * (right - left) / 2).mid()
    slope = arb_poly([radius * arb(0).union(largest)])
    time = slope.integral()
    time = time + (begin - time((left - centre) / radius))
    ends = left + stretch.shift, right + stretch.shift
    return TimePiece(*ends, begin, centre + stretch.shift, radius, slope, time, np.zeros((1, 6)))


@lru_cache(maxsize=64)
def _circle(count: int, precision: int) -> tuple[acb, ...]:
    """Return the count/2 + 1 roots of unity of the upper half plane, from 1 to −1."""
    with ctx.workprec(precision):
        return tuple(acb(arb(2 * j) / count).exp_pi_i() for j in range(count // 2 + 1))
