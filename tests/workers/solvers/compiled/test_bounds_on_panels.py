"""Bounds on whole discs and panels: nothing that lies between the nodes is passed over."""

import cmath
from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.problem import PlanarMotion
from tests.support.effort import each_once
from tests.support.planar import body, formula
from workers.solvers.compiled.discs.rows import derivatives_on_discs, put_disc, put_pole
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.frame import make_frame
from workers.solvers.compiled.records import new_records
from workers.solvers.compiled.solve_set import equator_of, new_formula
from workers.solvers.compiled.windows.arcs import scan_half
from workers.solvers.compiled.workspace import DISC_WORKSPACE, WORKSPACE

FORMULAS = [
    "-g1",
    "(3*g1^2+g3^2)*(g2^2-1/2+g2^3/5)",
    "abs(g1)^(4/3)/7 - 2*abs(g3)^(-4)",
    "exp(-g1*g3) + log(abs(g3)) - sin(g1)*cos(g2) + tan(g3/2)",
    "sqrt(1+g1^2)*abs(g3) - g1/(2+g2)",
    "(2+g1)^(g3+g2) + pi*g1^40",
    "16*g1*(8*g1^4+16*g1^2*g3^2+9*g3^4) + 16*g3^6/g1 - g3^8/g1^3",
    "-g1 + (2*g1^2+g3^2)*exp(-100*(g2-3/10)^2)",
]
BODIES = [body(2, 1), body("17/10", 1), body(3, 1), body(3, 5)]


class ComplexAlgebra:
    """Numbers of the complex plane, on the branch that is real on the positive axis."""

    def add(self, x, y):
        return x + y

    def subtract(self, x, y):
        return x - y

    def multiply(self, x, y):
        return x * y

    def divide(self, x, y):
        return x / y

    def negate(self, x):
        return -x

    def constant(self, value):
        return complex(value)

    def pi(self):
        return complex(np.pi)

    def power(self, x, exponent):
        whole = exponent.denominator == 1
        return x ** int(exponent) if whole else cmath.exp(float(exponent) * cmath.log(x))

    def general_power(self, x, y):
        return cmath.exp(y * cmath.log(x))

    def call(self, name, x):
        if name == "abs":
            return x if x.real > 0 else -x
        if name == "sign":
            return 1.0 if x.real > 0 else -1.0
        return {"exp": cmath.exp, "log": cmath.log, "sin": cmath.sin, "cos": cmath.cos, "tan": cmath.tan}[
            name
        ](x)


def exact(tape, loop, v, half):
    """Return D at a complex v of the northern or southern quarter."""
    alpha = float(loop.alpha)
    sine = cmath.sin(v)
    first, third = loop.g * sine**alpha, half * loop.z * sine
    second = cmath.sqrt(1 - first * first - third * third)
    second = second if (second / cmath.cos(v)).real > 0 else -second
    g1, g3 = (third, first) if loop.mirrored else (first, third)
    jets = FirstOrderJets(ComplexAlgebra(), 1)
    seeds = [jets.seed(g1, (-g3,)), jets.seed(second, (None,)), jets.seed(g3, (g1,))]
    return tape.evaluate(jets, seeds).first[0]


def loop_of(rigid_body, log_lambda=-0.2):
    frame = make_frame(rigid_body, PlanarMotion(Fraction(1)))
    loop = frame.loop
    loop.z, loop.g = equator_of(loop.alpha, log_lambda)
    return loop


@pytest.mark.one_in(4)
@pytest.mark.parametrize("text", FORMULAS)
@pytest.mark.parametrize("rigid_body", BODIES, ids=lambda each: f"{each.A}:{each.C}")
def test_discs_hold_what_the_formula_is_in_the_complex_plane(rigid_body, text):
    tape, loop = formula(text, rigid_body).tape, loop_of(rigid_body)
    program, constants = make_program(tape)
    draws = np.random.default_rng(5)
    centres = draws.uniform(0.03, np.pi - 0.03, 30)
    radii = draws.choice([0.0, 1e-8, 1e-3, 0.02, 0.1, 0.3], 30) * np.minimum(centres, np.pi - centres)
    half = float(draws.choice([-1.0, 1.0])) if "abs(g3)" in text else 1.0
    discs, worked = new_records(DISC_WORKSPACE)[0], new_formula(*program[:3], constants)
    for m in range(30):
        put_disc(discs, m, half * np.sin(centres[m]), np.cos(centres[m]), radii[m])
    for k, side in enumerate((1.0, -1.0)):
        put_pole(discs, 30 + k, 0.06, side, half)
    row = derivatives_on_discs(worked, loop, discs, 32)
    c, r, e = worked.discs
    known = 0
    for m in range(32):
        angles = 2j * np.pi * np.arange(9) / 9
        if m < 30:
            places = [centres[m] + radii[m] * x for x in (0.0, *np.exp(angles), *(0.7 * np.exp(angles)))]
        else:
            places = [np.arcsin(x) + 0j for x in (1e-5, 1e-3, 0.03, 0.06)]
            places = places if m == 30 else [np.pi - v for v in places]
        if not r[row, m] < np.inf:
            continue
        known += 1
        for v in places:
            value = exact(tape, loop, v, half) * cmath.sin(v) ** -e[row]
            # The reference has roundings of its own, which cancellation near a pole makes large.
            assert abs(value - c[row, m]) <= r[row, m] + 1e-10 * (abs(value) + 1.0)
    # Discs are at most three tenths of the way to the pole: nearly all must be known.
    assert known >= 29


def scanned(rigid_body, text, log_lambda=0.0):
    loop = loop_of(rigid_body, log_lambda)
    program, constants = make_program(formula(text, rigid_body).tape)
    worked, zeros = new_formula(*program[:3], constants), np.empty(16)
    count, *ends = scan_half(worked, loop, 1.0, zeros, new_records(WORKSPACE)[0])
    sine, cosine = 1.0 / np.cosh(zeros[: max(count, 0)]), -np.tanh(zeros[: max(count, 0)])
    height = cosine * np.sqrt(loop.z**2 + loop.g**2 * (1.0 + sine * sine))
    return count, ends, height


@each_once(width=list(range(1, 9)), place=["3/10", "-717/1000", "1/3", "9/10"], sign=["", "-"])
def test_what_is_narrow_is_found_or_left_open(width, place, sign):
    """A bump of (2 g1² + g3²) F(g2) adds a multiple of F to P: -g1 alone has P > 0 on the whole loop."""
    bump = f"(2*g1^2+g3^2)*50*exp(-10^{2 * width}*(g2-({place}))^2)"
    count, _, heights = scanned(body(2, 1), f"{sign}(-g1+{bump})")
    assert count in (-1, 2)
    if count == 2:
        # One zero on either side, where the bump has fallen to the size of the other term.
        assert heights[0] > float(Fraction(place)) > heights[1]
        assert heights[0] - heights[1] <= 6.0 * 10.0**-width


def test_narrow_things_are_mostly_found():
    found = [
        scanned(body(2, 1), f"-g1+(2*g1^2+g3^2)*50*exp(-10^{2 * width}*(g2-3/10)^2)")[0] for width in (1, 2)
    ]
    assert found == [2, 2]


@pytest.mark.parametrize("roots", [(0.2, 0.5), (0.1, 0.11), (0.001, 0.6)])
def test_zeros_are_those_of_the_polynomial(roots):
    # nu = 1: P is -2 c (x - first)(x - second)/x up to a positive factor, x = |g1|.
    first, second = map(Fraction, map(str, roots))
    text = f"({first + second})*g1 - 1/2*({first * second})/g3^2 - 1/2*(g1^2-g2^2)"
    count, _, heights = scanned(body(2, 1), text)
    assert count == 4
    # On the curve g3² = x.
    expected = [float(1 - x * x - x) ** 0.5 for x in (first, second)]
    assert np.allclose(heights, [expected[0], expected[1], -expected[1], -expected[0]], rtol=0, atol=1e-12)


@pytest.mark.parametrize("gap", range(3, 13))
def test_zeros_about_to_merge_are_found_or_left_open(gap):
    second = Fraction(1, 2)
    first = second - Fraction(1, 10**gap)
    count, _, _ = scanned(
        body(2, 1), f"({first + second})*g1 - 1/2*({first * second})/g3^2 - 1/2*(g1^2-g2^2)"
    )
    assert count in (-1, 4)
