"""V1[F] of sums of powers by a hypergeometric function is the integral that it stands for."""

from fractions import Fraction

import pytest
from flint import acb, arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.potentials.angular_part.balls import CurveFunction, angular_balls, powers_of
from tests.dynamics.potentials.angular_part.test_doubles import curve_function
from tests.support.effort import each_once

BODIES = [("2", "1"), ("7/3", "1"), ("3", "5"), ("101/100", "1"), ("31/3", "1")]
SUMS = {
    "-sqrt(w)/2": {"1/2": "-1/2"},
    "w^(3/7)/3 - w": {"3/7": "1/3", "1": "-1"},
    "w^(-5/4) - 3": {"-5/4": "1", "0": "-3"},
    "w^2 - w^(-1/11)": {"2": "1", "-1/11": "-1"},
}


def exact(text: str) -> arb:
    value = Fraction(text)
    return arb(value.numerator) / value.denominator


@each_once(g1__g3=[("0.4", "0.7"), ("0.001", "0.5"), ("0.9", "0.01")], text=list(SUMS), A__C=list(BODIES))
def test_it_is_the_integral(A, C, text, g1, g3):
    body = RigidBody(Fraction(A), None, Fraction(C), allow_unphysical=True)
    function = curve_function(text)
    assert powers_of(function.tape, body.alpha) is not None
    with ctx.workprec(128):
        alpha, zeta = exact(A) / exact(C), (arb(g3) / arb(g1)) ** 2
        rho = arb(g1) ** 2 + arb(g3) ** 2
        scale = (abs(exact(A) - exact(C)) * rho) ** (alpha - 1)
        T = (alpha + zeta) / (1 + zeta)
        found = angular_balls(body, function, 1, arb(g1), arb(g3), arb.pi() / 3)
        for k, value in enumerate(found):
            # The integral over y = log z, typed by hand; θ multiplies a power by its exponent.
            def integrand(y: acb, analytic: bool, k: int = k) -> acb:
                z = y.exp()
                w = scale * (alpha * y + (1 - alpha) * (1 + z).log(analytic)).exp()
                terms = (
                    exact(c) * exact(m) ** k * (exact(m) * w.log(analytic)).exp()
                    for m, c in SUMS[text].items()
                )
                return sum(terms, acb(0)) * z / (alpha + z) ** 2

            whole = acb.integral(integrand, acb(arb(3).log()), acb(zeta.log())).real
            assert value.overlaps((1 - alpha) * T * whole)
            # Terms of different exponents and the two ends cancel a part: by no more than half of the bits.
            assert value.rel_accuracy_bits() > 64


@pytest.mark.parametrize("text", ["exp(-w)", "w/(1 + w)", "w^(-1/2)", "abs(w - 1)", "log(w)", "sqrt(1 + w)"])
def test_other_functions_are_left_to_the_integral(text):
    # αm + 1 = 0 for m = −1/2, α = 2: V1 has a logarithm.
    assert powers_of(CurveFunction(curve_function(text).tape).tape, Fraction(2)) is None
