"""Motions in elliptic functions as formulas: against the equation they solve, and published periods."""

from fractions import Fraction

import mpmath
import pytest

from service.dynamics.body import RigidBody
from service.dynamics.formula.tree import Binary, Call, Negation, Number, Symbol, Tree, format_tree
from service.dynamics.potentials.families.written import expression_potential
from service.dynamics.potentials.recognition import recognise
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.formulas import elliptic_motion
from service.dynamics.reduction.windows import find_windows

BODY = RigidBody(Fraction(2), None, Fraction(1))
BOTH_REST = "-g1 + 1/(50*g3^2) + 6/5*(g1^2 - g2^2)"
CASES = {
    # Text, nu, period of the six variables (ODE with 220 bits, worst error 1e-12 of its doubles; theory 1.6).
    "pole to equator": ("-g1", "1", "6.432310535121612579869958267408499", 1e-32),
    "pole to equator, g1 < 0": ("g1", "-13/10", "6.130431451127", 2e-12),
    "pole to equator, nu": ("-g1", "13/10", "6.130431451127", 2e-12),
    "rest to equator": ("-g1 + 1/(20*g3^2)", "1", "6.34007793723281", 5e-14),
    "rest to rest": (BOTH_REST, "1", "3.41323191530593", 5e-14),
    "pole to rest": ("-g1 + 6/5*(g1^2 - g2^2)", "1", "6.97000159489442", 5e-14),
}


def value(tree: Tree, names: dict[str, mpmath.mpf]) -> mpmath.mpf:
    match tree:
        case Number(number):
            return mpmath.mpf(number.numerator) / number.denominator
        case Symbol(name):
            return names[name]
        case Negation(operand):
            return -value(operand, names)
        case Call("sqrt", argument):
            return mpmath.sqrt(value(argument, names))
        case Binary(operator, left, right):
            a, b = value(left, names), value(right, names)
            return {"+": a + b, "-": a - b, "*": a * b, "/": a / b if operator == "/" else 0, "^": a**b}[
                operator
            ]
    raise AssertionError(tree)


def motion(text: str, nu: str):
    """Return g1 as a function of time, the period, and x1, x2, k of the only window."""
    planar = PlanarMotion(None, Fraction(nu))
    potential = expression_potential(text, {}, BODY)
    sign = planar.sign_of_g1
    (window,) = find_windows(BODY, potential, planar)
    terms = recognise(BODY, potential, sign)
    assert terms is not None
    found = elliptic_motion(BODY, terms, abs(Fraction(nu)), sign, window)
    assert found is not None
    names = {name: value(found[name], {}) for name in ("x1", "x2")}

    def k(x: mpmath.mpf) -> mpmath.mpf:
        return value(found["k"], {**names, "x": x})

    names |= {"k(x1)": k(names["x1"]), "k(x2)": k(names["x2"])}
    for name in ("Omega", "kappa", "m"):
        names[name] = value(found[name], names)

    def g1(t: mpmath.mpf) -> mpmath.mpf:
        cn = mpmath.ellipfun("cn", names["Omega"] * t, m=names["m"])
        return value(found["g1"], {**names, "cn": cn})

    period = value(found["period"], {**names, "K(m)": mpmath.ellipk(names["m"])})
    assert format_tree(found["cn"]) == "cn(Omega*t | m)"
    return g1, period, names, potential, sign


@pytest.mark.parametrize(("text", "nu", "expected", "within"), CASES.values(), ids=CASES)
def test_the_period_is_the_published_one(text: str, nu: str, expected: str, within: float) -> None:
    with mpmath.workdps(45):
        period = motion(text, nu)[1]
        # The digits that are printed.
        assert abs(period - mpmath.mpf(expected)) < within


@pytest.mark.parametrize(("text", "nu"), [case[:2] for case in CASES.values()], ids=CASES)
def test_the_motion_solves_the_reduced_equation(text: str, nu: str) -> None:
    with mpmath.workdps(60):
        g1, period, names, potential, sign = motion(text, nu)
        assert abs(abs(g1(mpmath.mpf(0))) - names["x1"]) < 1e-50
        for share in ("0.07", "0.2", "0.31"):
            t = period * mpmath.mpf(share)
            x, speed = g1(t), mpmath.diff(g1, t)
            # s² = D/(2 C³ g1 g3), dg1/dt = 2 C g1 g2 s, by derivatives of V that are written out here.
            nu_ = mpmath.mpf(Fraction(nu).numerator) / Fraction(nu).denominator
            g3_squared = nu_ * x
            g2_squared = 1 - x * x - g3_squared
            a1, b1, c1 = coefficients(potential, sign)
            D_over_g3 = -2 * b1 / g3_squared**2 * x - (a1 + 2 * c1 * x)
            s_squared = D_over_g3 / (2 * x)
            # mpmath differentiates with half of its digits.
            assert abs(speed**2 - 4 * x * x * g2_squared * s_squared) < 1e-25


def coefficients(potential, sign: int) -> list[mpmath.mpf]:
    terms = recognise(BODY, potential, sign)
    return [mpmath.mpf(c.numerator) / c.denominator for c in (terms.a1, terms.b1, terms.c1)]


@pytest.mark.parametrize(
    "text", ["-g1 + (1 + sqrt(5))/4*(g1^2 - g2^2)", "g1*g2", "-g1 + g2^3*(2*g1^2 + g3^2)"]
)
def test_other_potentials_have_no_such_formulas(text: str) -> None:
    assert recognise(BODY, expression_potential(text, {}, BODY)) is None
