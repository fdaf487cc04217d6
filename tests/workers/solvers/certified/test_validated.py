"""Validated integration: curves contain their functions, and enclosures contain motions known otherwise."""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import TypeVar

import mpmath
import numpy as np
import pytest
from flint import arb, arb_mat, arb_poly, arb_series, ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.problem import PlanarMotion
from tests.support.effort import examples, seldom
from tests.support.planar import body, formula
from tests.support.taylor import Equations, integrate, state_at
from workers.solvers.certified.certify import certify, is_narrow
from workers.solvers.certified.validated.enclose import Enclosure, enclose
from workers.solvers.certified.validated.step import StepCurves, StepTooLongError, size
from workers.solvers.certified.validated.system import EulerPoisson, record
from workers.solvers.errors import CertifiedUnavailableError

T = TypeVar("T")
Gradient = Callable[[arb_series, arb_series, arb_series], tuple[object, object, object]]

FIELDS: dict[str, tuple[str, Gradient]] = {
    "heavy": ("-g1+g2/3", lambda x, y, z: (-1, ball(Fraction(1, 3)), 0)),
    "wall": ("-g1+1/(20*g3^2)", lambda x, y, z: (-1, 0, -1 / (10 * z * z * z))),
    "quartic": ("g1^4+2*g2*g3^2", lambda x, y, z: (4 * x * x * x, 2 * z * z, 4 * y * z)),
    "transcendental": (
        "exp(g1)*sin(g2)+sqrt(2+g3)+log(2+g1)",
        lambda x, y, z: (x.exp() * y.sin() + 1 / (2 + x), x.exp() * y.cos(), (2 + z).rsqrt() / 2),
    ),
}
"""V with its derivatives written by hand."""
TIMES = [Fraction(1, 3), Fraction(1)]


def tape(formula: str, variables: tuple[str, ...] = ("g1", "g2", "g3")):
    return compile_tape(parse(formula), variables)


def enclosed(
    field: str, moments: Sequence[int | Fraction], state: Sequence[Fraction], times: list[Fraction], bits=64
) -> Enclosure:
    rigid_body = RigidBody(*map(Fraction, moments), allow_unphysical=True)
    return enclose(EulerPoisson(rigid_body, tape(field)), lambda: [ball(x) for x in state], times, bits)


@cache
def motion(seed: int):
    """Return exact moments, a state (γ on the sphere by rational angles), a field, and the states at TIMES.

    These are by the Taylor code of the tests, whose digits hold to 1e-60.
    """
    draw = random.Random(seed)
    moments = [Fraction(draw.randint(4, 30), 8) for _ in range(3)]
    omega = [Fraction(draw.randint(-30, 30), 16) for _ in range(3)]
    u, v = (Fraction(draw.randint(1, 9), 10) for _ in range(2))
    size = 1 + u * u + v * v
    state = [*omega, 2 * u / size, (1 - u * u - v * v) / size, 2 * v / size]
    field, gradient = FIELDS[sorted(FIELDS)[seed % len(FIELDS)]]
    with ctx.workprec(300):
        equations = Equations(tuple(moments), gradient, 70)
        last = ball(TIMES[-1])
        steps = integrate(
            equations, [ball(x) for x in state], lambda step, _: step.start + step.length > last
        )
        return moments, state, field, [state_at(steps, ball(t)) for t in TIMES]


def contains(state: Sequence[arb], truth: Sequence[arb]) -> bool:
    # The digits of the reference are good to 1e-60; the balls here are wider than 1e-45.
    return all(bool(value.contains(arb(exact.mid()))) for value, exact in zip(state, truth, strict=True))


@pytest.mark.random_law
def test_enclosures_contain_the_motion_of_independent_taylor_series():
    for seed in range(examples(2, 40)):
        moments, state, field, truths = motion(seed)
        found = enclosed(field, moments, state, TIMES)
        for values, truth in zip(found.states, truths, strict=True):
            assert contains(values, truth)
            assert all(is_narrow(value, 64) for value in values)


@pytest.mark.random_law
def test_wrong_enclosures_are_caught():
    """A start, a moment or a time that is wrong by 2^-58 leaves the balls, whose radii are 2^-72 and less."""
    wrong = Fraction(1, 2**58)
    for seed in range(examples(2, 20)):
        moments, state, field, truths = motion(seed)
        for changed in (
            enclosed(field, moments, [state[0] + wrong, *state[1:]], TIMES),
            enclosed(field, [moments[0] + wrong, *moments[1:]], state, TIMES),
            enclosed(field, moments, state, [t + wrong for t in TIMES]),
        ):
            assert not contains(changed.states[-1], truths[-1])


@pytest.mark.parametrize("bits", [128, *seldom(333)])
def test_as_many_bits_as_asked_for_are_proven_and_enclosed_by_fewer(bits):
    moments, state, field, _ = motion(3)
    times = [Fraction(-3, 7), Fraction(1)]
    few, many = (enclosed(field, moments, state, times, each) for each in (64, bits))
    for wide, narrow in zip(few.states, many.states, strict=True):
        assert all(is_narrow(value, bits) for value in narrow)
        assert all(x.contains(arb(y.mid())) for x, y in zip(wide, narrow, strict=True))


def test_the_free_body_moves_by_elliptic_functions():
    """Euler's case, A, B, C = 3, 2, 1: p = cn/2, q = -κ sn, r = 3 dn/2 of κt, with κ² = 3/4 and m = 1/3.

    From A p' = (B - C) q r and so on (Landau and Lifshitz, Mechanics, section 37): κ² = (A-C)(B-C) r0²/(AB),
    q0² = A (A-C) p0²/(B (B-C)) and m = A (A-B) p0²/(C (B-C) r0²).
    """
    state = [Fraction(1, 2), Fraction(0), Fraction(3, 2), Fraction(0), Fraction(0), Fraction(1)]
    found = enclosed("0*g1", (3, 2, 1), state, [Fraction(7)])
    with mpmath.workdps(60):
        rate, m = mpmath.sqrt(3) / 2, mpmath.mpf(1) / 3
        sn, cn, dn = (mpmath.ellipfun(kind, 7 * rate, m=m) for kind in ("sn", "cn", "dn"))
        texts = [mpmath.nstr(value, 50) for value in (cn / 2, -rate * sn, 3 * dn / 2)]
    with ctx.workprec(200):
        for value, text in zip(found.states[0][:3], texts, strict=True):
            assert value.contains(arb(arb(text).mid()))


def test_a_planar_motion_is_that_of_its_quadrature():
    """Bobylev and Steklov's motion, through poles: by the quadrature's elliptic functions, and by steps."""
    rigid_body, V = body(2, 1, Fraction(3, 2)), formula("-g1", body(2, 1))
    times = [Fraction(0), Fraction(1), Fraction(10)]
    planar = certify(rigid_body, V, PlanarMotion(Fraction(1)), times, 128)
    found = enclose(EulerPoisson(rigid_body, V.tape), lambda: planar.states[0], times, 64)
    assert all(
        x.overlaps(y) and is_narrow(x, 64) and is_narrow(y, 128)
        for states in zip(found.states, planar.states, strict=True)
        for x, y in zip(*states, strict=True)
    )


@dataclass(frozen=True)
class Linear:
    """y' = a y for a matrix of rationals."""

    matrix: Sequence[Sequence[Fraction]]

    @property
    def dimension(self) -> int:
        return len(self.matrix)

    def right_side(self, algebra: Algebra[T], state: Sequence[T]) -> list[T]:
        rows = []
        for row in self.matrix:
            terms = [algebra.multiply(algebra.constant(a), y) for a, y in zip(row, state, strict=True)]
            total = terms[0]
            for term in terms[1:]:
                total = algebra.add(total, term)
            rows.append(total)
        return rows


def test_a_linear_flow_is_the_exponential_of_its_matrix():
    """Fast turning, growth and decay: 60 turns, whose boxes would be e^60 wide without frames."""
    matrix = [
        [Fraction(x) for x in row] for row in ([0, -6, 1], [6, 0, 0], [0, Fraction(1, 3), Fraction(-1, 5)])
    ]
    start, t = [Fraction(1), Fraction(2), Fraction(-1)], Fraction(60)
    found = enclose(Linear(matrix), lambda: [ball(x) for x in start], [t], 64)
    assert found.precision < 64 + 40
    with ctx.workprec(300):
        truth = (arb_mat([[ball(t * x) for x in row] for row in matrix])).exp()
        for row in range(3):
            exact = sum((truth[row, k] * ball(start[k]) for k in range(3)), arb(0))
            assert found.states[0][row].contains(arb(exact.mid()))
        middle, error = found.forward.flow(t)
        for row, column in np.ndindex(3, 3):
            assert abs(arb(truth[row, column].mid()) - arb(middle[row, column])) <= arb(error[row, column])
    # 140 steps, each with the roundings of a sum of sizes e^2.6 about: 140 · 13 · 2^-44 = 1e-10.
    assert error.max() < 1e-9


@dataclass(frozen=True)
class Exploding:
    """y' = y² + 1, y = tan t."""

    dimension: int = 1

    def right_side(self, algebra: Algebra[T], state: Sequence[T]) -> list[T]:
        return [algebra.add(algebra.constant(Fraction(1)), algebra.multiply(state[0], state[0]))]


def test_a_singularity_ends_the_proof_with_the_time_until_which_it_holds():
    found = enclose(Exploding(), lambda: [arb(0)], [Fraction(3, 2), Fraction(-1)], 64)
    with ctx.workprec(200):
        for t, (value,) in zip((Fraction(3, 2), Fraction(-1)), found.states, strict=True):
            assert value.contains(arb(ball(t).tan().mid()))
    with pytest.raises(CertifiedUnavailableError, match=r"proven until t = 1\.570796"):
        enclose(Exploding(), lambda: [arb(0)], [Fraction(2)], 64)


def test_a_kink_ends_the_proof():
    """|g2| has one where γ leaves the hemisphere."""
    state = [Fraction(0), Fraction(0), Fraction(1), Fraction(3, 5), Fraction(4, 5), Fraction(0)]
    with pytest.raises(CertifiedUnavailableError, match="kink"):
        enclosed("abs(g2)", (1, 2, 3), state, [Fraction(3)])


FORMULAS = [
    "x*y-y^3+2/3",
    "1/(2+x)-x/y",
    "sqrt(5+x*y)+(3+x)^(-3/2)",
    "exp(x+y)*sin(2*x)",
    "log(2+x)*cos(y)-tan(x/2)",
    "(2+x)^(2/7)+y^(1+x)+pi*x",
    "abs(2+x)-abs(x-2)",
]


@dataclass(frozen=True)
class Formula:
    """The same formula of all variables as the rate of each."""

    tape: Tape

    @property
    def dimension(self) -> int:
        return len(self.tape.variables)

    def right_side(self, algebra: Algebra[T], state: Sequence[T]) -> list[T]:
        return [self.tape.evaluate(algebra, state)] * self.dimension


@pytest.mark.parametrize("formula", FORMULAS)
def test_curves_contain_their_functions_and_are_narrow(formula):
    """x and y of degree 3, y wide by 1e-12: at nine τ the curve contains the values of both ends of y."""
    first, second = arb_poly([0, 0.5, -0.25, 0.125]), arb_poly([2, -0.5, 0.25, 0.125])
    program = tape(formula, ("x", "y"))
    recorded = record(Formula(program)).right_side
    with ctx.workprec(100):
        curve = recorded.run(StepCurves(60), [first, second + arb(0, 1e-12)])[0]
        for k in range(9):
            tau = arb(k) / 8
            for side in (-1e-12, 0.0, 1e-12):
                exact = program.evaluate(BallAlgebra(), [first(tau), second(tau) + side])
                assert curve(tau).contains(arb(exact.mid()))
            # No derivative is above 50; terms of degree 61 are below 1e-12.
            assert curve(tau).rad() < 1e-10


@pytest.mark.parametrize("formula", ["1/x", "sqrt(x)", "log(x)", "abs(x)", "x^(1/3)", "x^x"])
def test_curves_refuse_what_may_vanish(formula):
    recorded = record(Formula(tape(formula, ("x",)))).right_side
    with pytest.raises(StepTooLongError):
        size(recorded.run(StepCurves(20), [arb_poly([1, -2])])[0])
