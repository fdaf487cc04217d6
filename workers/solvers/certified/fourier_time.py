r"""Time as one Fourier series of the phase, where dt/dθ is proven holomorphic on a strip.

With r_k from n equidistant values and ‖dt/dθ‖ ≤ M on \|Im θ\| ≤ a (:mod:`.strips.bound`) what the other
r_k alias, and what they leave out, changes dt/dθ by at most

.. math:: \varepsilon = 2 M e^{-an/2}

all over the real axis, and t(θ) by ε θ. θ(t) is enclosed by steps of the interval Newton method
from where doubles find it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, log

import numpy as np
from flint import acb, acb_poly, arb, ctx
from numpy.typing import NDArray

from workers.solvers.certified.errors import PrecisionNeededError
from workers.solvers.certified.phase import LibrationPhase, RotationPhase
from workers.solvers.certified.trapezoid import ProvenStrip

FloatArray = NDArray[np.float64]

FIRST_PHASE_ERROR = 2.0**-46
"""Error of a phase in doubles."""
FIRST_PRECISION, SPARE = 128, 32
"""Precision of the first step; bits that others have beyond twice the digits that are there."""
WIDENING_FACTOR = 64
MAX_WIDENINGS = 5
MIN_RADIUS_RATIO = 32.0
"""Multiple of the radius that the time itself has as a phase, from which on a step is not worth it."""
MAX_NARROWING_FACTOR = 2.0**-16
"""Factor by which a step must narrow a radius, or else it is the last."""
BLOCK_SIZE = 64
"""Coefficients that are summed up at once."""
GRID_PHASES = 2048
NEWTON_STEPS = 3
NEGLIGIBLE_COEFFICIENT = 1e-18
"""Coefficients below this, of the mean, say nothing in doubles."""


@dataclass(frozen=True, slots=True)
class FourierTime:
    """t(θ), 0 at θ = 0, and θ(t)."""

    mean: arb
    """r_0."""
    slopes: tuple[acb_poly, ...]
    """dt/dθ = r_0 + Re Σ 2 r_k z^k, z = e^{iθ}: exact coefficients, in blocks."""
    times: tuple[acb_poly, ...]
    """t = r_0 θ + Im Σ (2 r_k / k)(z^k − 1)."""
    beginning: arb
    """The imaginary part of that sum at θ = 0."""
    rest: arb
    """0 ± ε, and what the coefficients were rounded by."""
    largest: arb
    """Bound of dt/dθ."""
    bend: arb
    """Bound of its derivative, but for the rest."""
    is_even: bool

    @property
    def period(self) -> arb:
        """Return the time of a turn."""
        return 2 * arb.pi() * (self.mean + self.rest)

    @property
    def span(self) -> arb:
        """Return the time of the whole turn, or of half of it if dt/dθ is even."""
        return self.period / 2 if self.is_even else self.period

    def time_at(self, theta: arb) -> arb:
        """Return t for 0 ≤ θ ≤ 2π, or not much beyond."""
        middle, off = theta.mid(), arb(0, (self.largest * theta.rad()).abs_upper())
        waves = self._sum(self.times, middle).imag
        return (self.mean + self.rest) * middle + waves - self.beginning + off

    def rate(self, theta: arb) -> arb:
        """Return dt/dθ."""
        off = arb(0, (self.bend * theta.rad()).abs_upper())
        return self.mean + self.rest + self._sum(self.slopes, theta.mid()).real + off

    def _sum(self, blocks: tuple[acb_poly, ...], theta: arb) -> acb:
        """Return the value at an exact θ; every product with z may widen a complex ball by √2."""
        with ctx.workprec(ctx.prec + BLOCK_SIZE // 2 + len(blocks)):
            sine, cosine = theta.sin_cos()
            z = acb(cosine, sine)
            step, total = z**BLOCK_SIZE, blocks[-1](z)
            for block in blocks[-2::-1]:
                total = total * step + block(z)
            return total

    def phases_at(self, times: Sequence[arb]) -> list[arb]:
        """Return θ at any times, up to whole turns."""
        period = self.period
        reduced = [t - (t / period).mid().floor().mid() * period for t in times]
        guesses = self._guesses(np.array([float(t) for t in reduced]))
        return [self._phase(t, arb(guess)) for t, guess in zip(reduced, guesses.tolist(), strict=True)]

    def _phase(self, t: arb, middle: arb) -> arb:
        """Return θ where the time is ``t``, from a phase next to it."""
        doubt, full = arb(FIRST_PHASE_ERROR), ctx.prec
        with ctx.workprec(min(full, FIRST_PRECISION)):
            late = self.time_at(middle) - t
            for _ in range(MAX_WIDENINGS):
                guess = arb(middle, doubt)
                found = middle - late / self.rate(guess)
                if guess.contains(found):
                    break
                doubt = WIDENING_FACTOR * doubt
            else:
                raise PrecisionNeededError("the inverse of time")
        return self._narrowed(t, found, full)

    def _narrowed(self, t: arb, theta: arb, full: int) -> arb:
        """Return the phase by steps that double its digits, at no more precision than they need."""
        least = MIN_RADIUS_RATIO * (t.rad() + self.rest.rad()) / self.mean
        while theta.rad() > least:
            precision = min(full, SPARE - 2 * int(float(theta.rad().log() / arb.const_log2())))
            with ctx.workprec(precision):
                middle = theta.mid()
                found = middle - (self.time_at(middle) - t) / self.rate(theta)
            if not found.rad() < MAX_NARROWING_FACTOR * theta.rad():
                return theta if theta.rad() < found.rad() else found
            theta = found
        return theta

    def _guesses(self, times: FloatArray) -> FloatArray:
        """Return θ in doubles."""
        mean = float(self.mean)
        r = np.zeros(BLOCK_SIZE * len(self.slopes), dtype=np.complex128)
        for n, block in enumerate(self.slopes):
            found_here = [complex(value) for value in block.coeffs()]
            r[BLOCK_SIZE * n : BLOCK_SIZE * n + len(found_here)] = found_here
        r = r[: 1 + int(np.flatnonzero(np.abs(r) > NEGLIGIBLE_COEFFICIENT * mean).max(initial=0))]
        s = (r / np.maximum(np.arange(len(r)), 1)).astype(np.complex128)
        grid = np.linspace(0.0, 2.0 * np.pi, GRID_PHASES + 1)
        beginning = float(s.sum().imag)
        found = np.interp(times, mean * grid + _horner(s, grid).imag - beginning, grid)
        for _ in range(NEWTON_STEPS):
            late = mean * found + _horner(s, found).imag - beginning - times
            found = found - late / (mean + _horner(r, found).real)
        return np.asarray(found)


def make_fourier_time(phase: LibrationPhase | RotationPhase, strip: ProvenStrip, bits: int) -> FourierTime:
    """Return the model to so many bits, at the current precision."""
    height, largest = strip.height, strip.largest
    size = float(next(phase.rates(4)))
    count = 4 * ceil((bits * log(2.0) + max(0.0, log(largest / size))) / height / 2.0)
    values = list(phase.rates(count))
    if phase.is_even:
        values += values[::-1]
    sums = acb.dft(values)
    turns = _half_steps(count)
    r = [total * turn / count for total, turn in zip(sums, turns, strict=False)]
    rest = 2 * arb(largest) * (-arb(height) * count / 2).exp()
    rest += sum((2 * (value.real.rad() + value.imag.rad()) for value in r), arb(0))
    r = [value.mid() for value in r]
    quotients = [2 * value / max(k, 1) for k, value in enumerate(r)]
    # |z^k − 1| ≤ k θ.
    rest += sum((k * (value.real.rad() + value.imag.rad()) for k, value in enumerate(quotients)), arb(0))
    times = _blocks([value.mid() for value in quotients])
    sizes = [abs(2 * value) for value in r]
    return FourierTime(
        mean=r[0].real,
        slopes=_blocks([2 * value for value in r]),
        times=times,
        beginning=sum((block(1) for block in times), acb(0)).imag,
        rest=arb(0, rest.abs_upper()),
        largest=sum(sizes, arb(0)) + rest,
        bend=sum((k * size for k, size in enumerate(sizes)), arb(0)),
        is_even=phase.is_even,
    )


def _blocks(coefficients: list[acb]) -> tuple[acb_poly, ...]:
    """Return Σ c_k z^k without c_0, as polynomials that are to be multiplied by powers of z^BLOCK_SIZE."""
    whole = [acb(0), *coefficients[1:]]
    return tuple(acb_poly(whole[n : n + BLOCK_SIZE]) for n in range(0, len(whole), BLOCK_SIZE))


def _half_steps(count: int) -> list[acb]:
    """Return e^{−ikπ/count}: the values are taken half a step from θ = 0 on."""
    return [(-arb(k) / count * acb(1)).exp_pi_i() for k in range(count // 2)]


def _horner(coefficients: NDArray[np.complex128], theta: FloatArray) -> NDArray[np.complex128]:
    z = np.exp(1j * theta)
    total = np.full(len(theta), coefficients[-1])
    for value in coefficients[-2::-1]:
        total = total * z + value
    return total
