"""Relations for powers of generators, and polynomials with such a power replaced."""

from dataclasses import dataclass

from flint import fmpq_mpoly, fmpq_mpoly_ctx

from service.dynamics.verdict.exact_ring.generators import Element
from service.dynamics.verdict.exact_ring.work import Work, height


@dataclass(frozen=True, slots=True)
class Relation:
    """clearing · u^power = tail, as the polynomial clearing · u^power - tail, u a generator."""

    index: int
    """The generator."""
    power: int
    polynomial: fmpq_mpoly
    clearing: tuple[int, ...] | None
    tail_terms: int
    step: int
    """Amount by which one replacement lowers the power."""

    @classmethod
    def of(cls, context: fmpq_mpoly_ctx, index: int, power: int, base: Element) -> "Relation":
        """Return u^power = base, its negative exponents cleared to the left side."""
        below = tuple(max(-exponent, 0) for exponent in base.shift)
        above = tuple(max(exponent, 0) for exponent in base.shift)
        tail = base.numerator * context.term(exp_vec=above)
        left = list(below)
        left[index] += power
        return cls(
            index,
            power,
            context.term(exp_vec=tuple(left)) - tail,
            below if any(below) else None,
            len(tail),
            power - max(int(tail.degrees()[index]), 0),
        )

    def applied_to(self, x: Element, context: fmpq_mpoly_ctx, work: Work) -> Element:
        """Return x, an equal element with powers of u below ``power`` alone; raises NoProofError."""
        numerator, shift = x.numerator, x.shift
        excess = int(numerator.degrees()[self.index]) - self.power
        if excess < 0:  # flint gives the zero polynomial the degree -1
            return x
        times = excess // self.step + 1
        growth = times * (height(self.polynomial) + self.tail_terms.bit_length())
        work.expand(self.tail_terms, times, len(numerator), height(numerator) + growth)
        if self.clearing is not None:
            numerator *= context.term(exp_vec=tuple(times * e for e in self.clearing))
            shift = tuple(a - times * b for a, b in zip(shift, self.clearing, strict=True))
        return Element(numerator % self.polynomial, shift)
