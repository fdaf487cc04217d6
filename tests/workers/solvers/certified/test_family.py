"""Motions through poles as functions of time: their way in doubles against enclosures and the quadrature."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.motion import Motion
from service.dynamics.problem import Accuracy, PlanarMotion, Problem
from tests.support.planar import body, planar
from workers.solvers.assembly.families import NOT_MINE, Declined, PeriodicPlace, Place
from workers.solvers.certified.certify import certify
from workers.solvers.certified.family import WayFamily
from workers.solvers.certified.time_model import CertifiedUnavailableError, TimeModel
from workers.solvers.choose import with_enough_bits
from workers.solvers.quadrature.family import QuadratureFamily

WAY, QUADRATURE = WayFamily(), QuadratureFamily()
SPECIAL = "-abs(g1)^(2*(A-C)/A)"
# Round through both poles; from rest to rest through one; the same with g1 and g3 exchanged.
PASSING = {
    "round": planar(body("7/5", 1), SPECIAL, PlanarMotion(Fraction(1)), (0, 9, 23)),
    "half power": planar(body("101/2", 1), SPECIAL, PlanarMotion(Fraction(1)), (0, 300, 23)),
    "steep": planar(body("5/2", 1), SPECIAL, PlanarMotion(Fraction(1)), (0, 9, 23)),
    "libration": planar(
        body("7/5", 1), f"{SPECIAL} + (A*g1^2 + C*g3^2)*(1 + g2/5)", PlanarMotion(Fraction(1)), (0, 9, 23)
    ),
    "mirrored": planar(
        body(1, "7/5"),
        "-abs(g3)^(4/7) + (A*g1^2 + C*g3^2)*(1 + g2/5)",
        PlanarMotion(Fraction(1), g1_sign=-1, g3_sign=-1),
        (-9, 9, 23),
    ),
}


def solved(problem: Problem, family: WayFamily | QuadratureFamily) -> Motion | Declined:
    def solve(problem: Problem, found: Place) -> Motion | Declined:
        place = PeriodicPlace(found.window, found.start)
        return family.solve(problem, place) if family.takes(problem, place) else NOT_MINE

    return with_enough_bits(problem, solve)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", PASSING)
def test_the_function_of_time_keeps_its_claim(name):
    """Against enclosures of 128 bits, at the samples and at times next to every passage of a pole."""
    problem = PASSING[name]
    found = solved(problem, WAY)
    assert isinstance(found, Motion)
    assert found.first_passage is not None
    # What is told next to a pole is a power of rounded times, by the exponent A/C − 1 = 2/5 at least.
    assert found.dense.error < 1e-4
    near = found.first_passage + np.array([-1e-3, -1e-6, 1e-6, 1e-3])
    times = np.concatenate([found.times, near])
    exact = certify(
        problem.body, problem.potential, problem.motion, [Fraction(t) for t in times.tolist()], 128
    )
    claims = [found.dense.error_at(np.array([t])) for t in times]
    with ctx.workprec(192):
        for state, told, claim in zip(exact.states, found.dense(times), claims, strict=True):
            assert all(
                abs(ball - arb(value)) <= claim for ball, value in zip(state, told.tolist(), strict=True)
            )
        told = found.dense.period
        assert abs(exact.period - arb(told.hi) - arb(told.lo)) <= told.error + exact.period.rad()
    assert told.error < 1e-16 * told.hi


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("moments", "text"),
    [
        (("5/2", 1), SPECIAL),
        (("7/3", 1), f"{SPECIAL} + (A*g1^2 + C*g3^2)*(1 + g2/5)"),
        ((1, "7/3"), "-abs(g3)^(8/7)"),
    ],
)
def test_where_r_has_a_slope_at_a_pole_the_function_of_time_is_known_to_roundings(moments, text):
    found = solved(planar(body(*moments), text, PlanarMotion(Fraction(1), window=0), (0, 9, 23)), WAY)
    assert isinstance(found, Motion)
    # Forces are like |g1|^(1 − 2C/A): where g1 is off by 1e-16 they are by 6e-4, and the defect is 5e-11.
    # What is left are some roundings of times, 1e-15 each, and of numbers of the size 1.
    assert found.dense.error < 1e-13


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", ["round", "libration"])
def test_it_is_that_of_the_quadrature_which_knows_nothing_of_the_pole(name):
    found, other = solved(PASSING[name], WAY), solved(PASSING[name], QUADRATURE)
    other = other.found if isinstance(other, Declined) else other
    assert isinstance(found, Motion)
    assert isinstance(other, Motion)
    assert np.abs(found.samples - other.samples).max() <= found.error + other.error
    assert np.abs(found.dense.period.hi - other.dense.period.hi) <= 1e-15 * other.dense.period.hi
    assert found.evidence["panels"] < other.evidence["panels"] / 2


@pytest.mark.parametrize(
    ("A", "text"),
    [
        # No pole is passed; one at which everything is a function of sin v.
        (2, "-g1 + 1/(20*g3^2)"),
        (3, SPECIAL),
    ],
)
def test_other_motions_are_left_to_others(A, text):
    problem = planar(body(A, 1), text, PlanarMotion(Fraction(1)), (0, 1, 3))
    assert solved(problem, WAY) is NOT_MINE


@pytest.mark.long
def test_a_kink_on_the_way_is_left_to_the_quadrature():
    rigid_body = body("7/5", 1)
    text = f"{SPECIAL} + (A*g1^2 + C*g3^2)*abs(g2 - 1/2)/20"
    problem = planar(rigid_body, text, PlanarMotion(Fraction(1)), (0, 1, 3))
    assert solved(problem, WAY) is NOT_MINE
    with pytest.raises(CertifiedUnavailableError):
        certify(rigid_body, problem.potential, problem.motion, [Fraction(1)], 64)
    assert isinstance(solved(problem, QUADRATURE), Motion | Declined)


def test_enclosures_use_the_same_way(monkeypatch):
    """The way that is made for the function of time is not made once more: for samples, other tiers, and
    for who asks the same problem.
    """

    # A potential that no other test has: its way is not known before.
    def read() -> Problem:
        anew = planar(body("7/5", 1), f"3/4*({SPECIAL})", PlanarMotion(Fraction(1)), (0, 9, 23))
        return replace(anew, accuracy=Accuracy(1e-10, "standard"))

    problem = read()
    made = []
    original = TimeModel.__init__

    def counted(self: TimeModel, *parts: object) -> None:
        made.append(parts)
        original(self, *parts)

    monkeypatch.setattr(TimeModel, "__init__", counted)
    found = solved(problem, WAY)
    assert isinstance(found, Motion)
    assert len(made) == 1
    times = [Fraction(t) for t in found.times.tolist()]
    for asked in (problem, read()):
        certify(asked.body, asked.potential, asked.motion, times, asked.accuracy.bits)
        assert len(made) == 1
    # More bits are another way.
    certify(problem.body, problem.potential, problem.motion, times, 2 * problem.accuracy.bits)
    assert len(made) == 2
