"""Random admissible potentials: exact terms with random coefficients, and random points of the sphere."""

from collections.abc import Iterator
from fractions import Fraction
from random import Random

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from tests.dynamics.verdict.formulas import B_term, C_term, U, W, body, potential

MAX_ORDER = 12
"""Largest power of a coordinate in the denominators of a term."""


def fraction(random: Random, limit: int = 3) -> Fraction:
    return Fraction(random.randint(-20 * limit, 20 * limit), random.randint(10, 20))


def even_and_odd(random: Random) -> str:
    """Q times a quartic in g2 with even and odd powers."""
    powers = " + ".join(f"({fraction(random)})*g2^{k}" for k in range(5))
    return f"(A*g1^2 + C*g3^2)*({powers})"


def any_moments(random: Random) -> tuple[RigidBody, Potential]:
    """Terms on |g1| and |g3| for a random A/C, above or below 1, and terms odd in the signs of g1, g3."""
    alpha = Fraction(random.randint(1, 12), random.randint(3, 12))
    if alpha == 1:
        alpha = Fraction(5, 4)
    C = Fraction(random.randint(1, 9), random.randint(1, 4))
    texts = [even_and_odd(random), str(fraction(random))]
    for n in range(3):
        for sign in ("1", "abs(g1)/g1", "abs(g3)/g3"):
            if _B_is_defined(alpha, n) and abs(2 * (alpha - 1) * (n + 1) / alpha) <= MAX_ORDER:
                texts.append(f"({fraction(random)})*{sign}*{B_term(n, alpha)}")
            if _B_is_defined(1 / alpha, n) and abs(2 * (alpha * n + alpha - 1)) <= MAX_ORDER:
                texts.append(f"({fraction(random)})*{sign}*{C_term(n, alpha)}")
    on = body(alpha * C, C)
    return on, potential(" + ".join(texts), on)


def double_moment(random: Random) -> tuple[RigidBody, Potential]:
    """A = 2C: Laurent polynomials, those with U_n odd in g1."""
    C = Fraction(random.randint(1, 9), random.randint(1, 4))
    texts = [even_and_odd(random), str(fraction(random))]
    texts += [f"({fraction(random)})*{U(n)}" for n in range(1, 4)]
    texts += [f"({fraction(random)})*{W(n)}" for n in range(1, 4)]
    on = body(2 * C, C)
    return on, potential(" + ".join(texts), on)


def cases(count: int, seed: int) -> Iterator[tuple[RigidBody, Potential]]:
    """Three of any moments for each with A = 2C."""
    random = Random(seed)
    for number in range(count):
        yield double_moment(random) if number % 4 == 3 else any_moments(random)


def points(count: int, seed: int) -> NDArray[np.float64]:
    """Return points all over the sphere, shape (count, 3)."""
    gamma = np.random.default_rng(seed).normal(size=(count, 3))
    result: NDArray[np.float64] = gamma / np.linalg.norm(gamma, axis=1)[:, None]
    return result


def _B_is_defined(alpha: Fraction, n: int) -> bool:
    """Whether no denominator of the series vanishes: α is none of (n+1)/m, m = 1, …, n-1."""
    return all(alpha * m != n + 1 for m in range(1, n))
