"""Points modulo a prime, at which the gradients of integrals are compared.

Gradients that are independent there are independent. Those that are dependent at a random point are so
everywhere, but for a chance of some 10^-17.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

from flint import fmpz_mpoly

from service.dynamics.discovery.functions import ORDER, Functions, Quotient
from service.dynamics.discovery.setting import STATE
from service.dynamics.discovery.strata import (
    PRIME,
    Stratum,
    by_powers,
    evaluated,
    random_numbers,
    rank_modulo,
    root_modulo,
)

PRIMES = (PRIME, 2**61 - 31, 2**61 - 45, 2**61 - 229, 2**61 - 259, 2**61 - 283, 2**61 - 339)
"""Primes modulo one of which a condition that is solved for no letter may have a root."""
ROOT_TRIALS = 8
"""Random values of the letters at which it is looked for."""


@dataclass(frozen=True, slots=True)
class ModularPoint:
    """A random point of the sphere, on the level asked about, modulo a prime, with values of the letters."""

    prime: int
    letters: list[int]
    """In the order of their ring."""
    state: list[int]
    """m1, m2, m3, g1, g2, g3."""
    omega: list[int]
    moments: list[int]
    slopes: list[int]
    """The gradient of V."""
    values: list[int]
    """The values of all generators of the field."""

    @classmethod
    def on(cls, field: Functions, stratum: Stratum, *, has_zero_areas: bool) -> "ModularPoint | None":
        """Return the point; None if the unresolved condition has no root where it was looked for."""
        for prime in PRIMES:
            numbers = random_numbers(prime)
            letters = [next(numbers) for _ in field.letters.ring.gens()]
            if stratum.unresolved is None or _solve(stratum.unresolved, letters, numbers, prime):
                break
        else:
            return None
        for each in reversed(stratum.substitutions):
            below = evaluated(each.denominator, letters, prime)
            letters[each.index] = evaluated(each.numerator, letters, prime) * pow(below, -1, prime) % prime
        u, v, *m = islice(numbers, 5)
        scale = pow(1 + u * u + v * v, -1, prime)
        gamma = [2 * u * scale % prime, 2 * v * scale % prime, (1 - u * u - v * v) * scale % prime]
        if has_zero_areas:
            m[2] = -(m[0] * gamma[0] + m[1] * gamma[1]) * pow(gamma[2], -1, prime) % prime
        blank, setting = [0] * field.first_letter + letters, field.setting
        moments = [_modular(each, blank, prime) or 0 for each in field.moments()]
        omega = [each * pow(moment, -1, prime) % prime for each, moment in zip(m, moments, strict=True)]
        values = list(blank)
        for name, value in zip(STATE, (*omega, *gamma), strict=True):
            values[field.atoms + ORDER.index(name)] = value
        potential = field.gradient(setting.tape(setting.potential))
        slopes = [_modular(each, values, prime) or 0 for each in potential[3:]]
        return cls(prime, letters, [*m, *gamma], omega, moments, slopes, values)

    def classical(self) -> list[dict[int, int]]:
        """Return the gradients of |γ|², of the areas and of the energy."""
        m, gamma = self.state[:3], self.state[3:]
        return [
            dict(enumerate([0, 0, 0, *gamma])),
            dict(enumerate([*gamma, *m])),
            dict(enumerate([*self.omega, *self.slopes])),
        ]

    def rank(self, gradients: Sequence[Mapping[int, int]]) -> int:
        """Return how many of the gradients are independent."""
        return rank_modulo(gradients, 6, self.prime)

    def gradient(self, monomials: Sequence[tuple[int, ...]], vector: Mapping[int, int]) -> dict[int, int]:
        """Return the gradient of a combination of monomials."""
        total = dict.fromkeys(range(6), 0)
        for place, value in vector.items():
            monomial = monomials[place]
            for k, exponent in enumerate(monomial):
                if exponent:
                    term = value * exponent
                    for j, (base, power) in enumerate(zip(self.state, monomial, strict=True)):
                        term = term * pow(base, power - (j == k), self.prime) % self.prime
                    total[k] += term
        return total

    def gradient_of(self, slopes: Sequence[Quotient]) -> dict[int, int] | None:
        """Return a gradient along p, q, r, g1, g2, g3 as one along the momenta; None if it has no value."""
        found: dict[int, int] = {}
        for k, each in enumerate(slopes):
            value = _modular(each, self.values, self.prime)
            if value is None:
                return None
            found[k] = value * pow(self.moments[k], -1, self.prime) if k < 3 else value
        return found


def _solve(condition: fmpz_mpoly, letters: list[int], numbers: Iterator[int], prime: int) -> bool:
    """Change the letters until the condition is 0 modulo the prime; return whether that succeeded."""
    degrees = [int(degree) for degree in condition.degrees()]
    index = min((k for k, degree in enumerate(degrees) if degree), key=lambda k: degrees[k])
    parts = by_powers(condition, index)
    for _ in range(ROOT_TRIALS):
        letters[:] = [next(numbers) for _ in letters]
        values = [evaluated(parts[k], letters, prime) if k in parts else 0 for k in range(degrees[index] + 1)]
        root = root_modulo(values, prime)
        if root is not None:
            letters[index] = root
            return True
    return False


def _modular(quotient: Quotient, values: Sequence[int], prime: int) -> int | None:
    below = evaluated(quotient.denominator, values, prime)
    return evaluated(quotient.numerator, values, prime) * pow(below, -1, prime) % prime if below else None
