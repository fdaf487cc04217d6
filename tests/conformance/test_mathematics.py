"""What every family owes the mathematics, each by a law that does not know the family."""

from collections.abc import Iterator
from fractions import Fraction
from itertools import islice, product
from random import Random

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.equations.compatibility import pde_residual
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.verdict import decide
from service.schemas.problem.problem import read_question
from tests.conformance.energies import ball, energy
from tests.conformance.specimens import SPECIMENS, Specimen
from tests.conformance.transforms import mirrored, scaled

every = pytest.mark.parametrize("specimen", SPECIMENS, ids=str)
BITS = 400
"""Precision of the enclosures: 60 digits are 200 bits, and where terms of 1e20 cancel another 70 go."""


def setting(document: dict) -> tuple[RigidBody, Potential]:
    question = read_question({name: document[name] for name in ("body", "potential")})
    return question.body, question.potential


def rational_points(seed: int, count: int) -> Iterator[tuple[Fraction, Fraction, Fraction]]:
    """Yield exact points of the sphere in all octants, not close to its coordinate circles."""
    random, found = Random(seed), 0
    while found < count:
        u, v = (Fraction(random.randint(-99, 99), 70) for _ in range(2))
        norm = 1 + u * u + v * v
        point = (2 - norm) / norm, 2 * u / norm, 2 * v / norm
        if min(map(abs, point)) > Fraction(1, 8):
            found += 1
            yield point


@pytest.mark.one_in(4)
@every
def test_it_is_proved_admissible(specimen: Specimen):
    verdict = decide(*setting(specimen.document))
    assert (verdict.verdict, verdict.proof) == ("admissible", "symbolic")


@pytest.mark.one_in(4)
@every
def test_the_compatibility_equation_is_enclosed_about_zero(specimen: Specimen):
    body, potential = setting(specimen.document)
    with ctx.workprec(BITS):
        for point in rational_points(1, 6):
            gamma = [ball(coordinate) for coordinate in point]
            _, first, second = potential.jet_ball(*gamma)
            L = pde_residual(ball(body.A), ball(body.C), gamma, first, second)
            assert L.contains(0)
            assert L.abs_upper() < arb("1e-60")


@pytest.mark.one_in(4)
@every
def test_derivatives_are_those_of_the_values(specimen: Specimen):
    _, potential = setting(specimen.document)
    with ctx.workprec(BITS):
        step = arb(2) ** -120
        for point in rational_points(2, 2):
            gamma = [ball(coordinate) for coordinate in point]
            V, first, second = potential.jet_ball(*gamma)
            assert V.overlaps(potential.value_ball(*gamma))
            for i in range(3):
                ahead, behind = (
                    [g + sign * step * (i == j) for j, g in enumerate(gamma)] for sign in (1, -1)
                )
                slope = (potential.value_ball(*ahead) - potential.value_ball(*behind)) / (2 * step)
                # Central differences: third derivatives, up to 1e10, by the step squared (2^-240).
                assert abs(slope - first[i]).abs_upper() < arb("1e-50") * (1 + abs(first[i]))
                firsts = [potential.jet_ball(*place)[1] for place in (ahead, behind)]
                for j in range(3):
                    bend = (firsts[0][j] - firsts[1][j]) / (2 * step)
                    assert abs(bend - second[i][j]).abs_upper() < arb("1e-50") * (1 + abs(second[i][j]))


@every
def test_doubles_are_the_balls_rounded(specimen: Specimen):
    _, potential = setting(specimen.document)
    points = list(rational_points(3, 4))
    gamma = np.array([[float(coordinate) for coordinate in point] for point in points])
    values, slopes, bends = potential.value(gamma), potential.gradient(gamma), potential.hessian(gamma)
    with ctx.workprec(BITS):
        for k, _ in enumerate(points):
            V, first, second = potential.jet_ball(*(arb(float(g)) for g in gamma[k]))
            expected = np.array(
                [float(V), *map(float, first), *(float(part) for row in second for part in row)]
            )
            found = np.array([values[k], *slopes[k], *bends[k].ravel()])
            # The sums cancel by some 1e4 at these points at most: 1e-16 becomes 1e-12 of the largest.
            assert np.max(np.abs(found - expected)) < 1e-12 * np.max(np.abs(expected))


@every
def test_H_is_the_printed_energy_all_along_a_curve(specimen: Specimen):
    body, potential = setting(specimen.document)
    with ctx.workprec(BITS):
        exponent = ball(body.C / body.A)
        for lam, s1, s3 in product((ball("3/5"), arb(1)), (1, -1), (1, -1)):
            expected = energy(specimen, lam, s1, s3)
            for x, s2 in ((ball("1/10"), 1), (ball("1/4"), -1)):
                third = lam * x**exponent
                point = s1 * x, s2 * (1 - x**2 - third**2).sqrt(), s3 * third
                H = potential.H_ball(body, *point)
                assert H.overlaps(expected)
                assert (H - expected).abs_upper() < arb("1e-60") * (1 + abs(expected))


@every
def test_a_multiple_of_the_document_is_the_multiple_of_the_potential(specimen: Specimen):
    k = Fraction(-7, 3)
    _, potential = setting(specimen.document)
    _, multiple = setting(scaled(specimen.document, k))
    with ctx.workprec(BITS):
        for point in rational_points(4, 3):
            gamma = [ball(coordinate) for coordinate in point]
            difference = multiple.value_ball(*gamma) - ball(k) * potential.value_ball(*gamma)
            assert difference.abs_upper() < arb("1e-60")


@every
def test_the_mirror_image_is_the_potential_with_the_axes_exchanged(specimen: Specimen):
    body, potential = setting(specimen.document)
    other_body, other = setting(mirrored(specimen.document))
    with ctx.workprec(BITS):
        for point in islice(rational_points(5, 4), 4):
            g1, g2, g3 = (ball(coordinate) for coordinate in point)
            assert (potential.value_ball(g1, g2, g3) - other.value_ball(g3, g2, g1)).abs_upper() < arb(
                "1e-60"
            )
            # The energy of a motion does not change in a mirror.
            difference = potential.H_ball(body, g1, g2, g3) - other.H_ball(other_body, g3, g2, g1)
            assert difference.abs_upper() < arb("1e-60")
