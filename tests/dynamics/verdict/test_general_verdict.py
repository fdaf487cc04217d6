"""The verdict on potentials given by an integral: admissible with the energy -F(w), for their own body."""

from fractions import Fraction

import pytest
from flint import arb, ctx, fmpq

from service.dynamics.equations.compatibility import residual_of
from service.dynamics.errors import EqualMomentsError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.verdict.proofs.energy_terms import energy_defect
from service.dynamics.verdict.sphere.boxes import sphere_points
from service.dynamics.verdict.verdict import UndefinedPotentialError, decide
from tests.dynamics.verdict.formulas import body


def ball(value: Fraction) -> arb:
    return arb(fmpq(value.numerator, value.denominator))


@pytest.mark.one_in(4)
@pytest.mark.parametrize("F", ["w", "exp(-w) - k", "w/(1+w)", "-sqrt(w)", "0", "log(w)"])
@pytest.mark.parametrize(("A", "C"), [("17/10", 1), (2, 1), (3, "3/2"), ("3/5", 1), (1, 2)])
def test_it_is_admissible_and_the_formula_is_its_energy(F, A, C):
    on = body(A, C)
    V = general_potential(on, F, "sin(g2) - g2^3", {"k": Fraction(1, 3)})
    verdict = decide(on, V)
    assert (verdict.verdict, verdict.proof) == ("admissible", "symbolic")
    assert verdict.energy_formulas is None
    in_nu = on.A == 2 * on.C
    h = compile_tape(parse(verdict.energy_formula), ("nu" if in_nu else "lambda",))
    with ctx.workprec(150):
        for point in list(sphere_points())[:8]:
            g1, g2, g3 = map(ball, point)
            curve = g3**2 / g1 if in_nu else abs(g3) / (abs(g1).log() / ball(on.alpha)).exp()
            energy = h.evaluate(BallAlgebra(), (curve,))
            assert energy.overlaps(V.H_ball(on, g1, g2, g3))
            # 150 bits are 45 digits; h is below 10^4 at these points.
            assert energy.rad() < arb("1e-35")


@pytest.mark.parametrize(
    ("A", "C", "F", "expected"),
    [
        (2, 1, "w", "-nu^2"),
        (3, "3/2", "w", "-(1.5*nu^2)"),
        ("17/10", 1, "exp(-w)", "-exp(-(0.7^0.7*lambda^3.4))"),
        (3, 2, "-w", "lambda^3"),
        (3, 1, "k", "-(1/3)"),
    ],
)
def test_formulas_are_short(A, C, F, expected):
    on = body(A, C)
    assert decide(on, general_potential(on, F, "0", {"k": Fraction(1, 3)})).energy_formula == expected


def test_an_energy_that_depends_on_the_quadrant_has_one_formula_for_each():
    on = body("17/10", 1)
    texts = {"pp": "w", "mp": "-w", "pm": "w", "mm": "1"}
    verdict = decide(on, general_potential(on, texts, "g2", {}))
    assert verdict.energy_formula is None
    assert verdict.energy_formulas == {
        "pp": "-(0.7^0.7*lambda^3.4)",
        "mp": "0.7^0.7*lambda^3.4",
        "pm": "-(0.7^0.7*lambda^3.4)",
        "mm": "-1",
    }


def test_the_energy_is_checked_by_values_of_V_alone():
    on = body("17/10", 1)
    V = general_potential(on, "exp(-w)", "g2", {})
    point = (Fraction(2, 7), Fraction(6, 7), Fraction(3, 7))
    defect = energy_defect(on, V, point)
    assert defect.contains(0)
    # H varies by 2^-64 = 5e-20 times its derivative over the arc.
    assert defect.rad() < arb("1e-17")
    assert not energy_defect(body("3/2", 1), V, point).contains(0)


def test_a_potential_of_another_body_is_refuted():
    V = general_potential(body(3, 1), "exp(-w)", "g2", {})
    on = body("17/10", 1)
    verdict = decide(on, V)
    assert (verdict.verdict, verdict.proof) == ("inadmissible", "counterexample")
    with ctx.workprec(300):
        residual = residual_of(on, V, verdict.counterexample.g).residual
        example = verdict.counterexample.residual
        assert not residual.contains(0)
        assert arb(f"{example.mid} +/- {example.rad}").overlaps(residual)


def test_a_potential_defined_on_part_of_the_sphere_is_admissible_there():
    on = body("3/5", 1)
    assert decide(on, general_potential(on, "sqrt(w - 3)", "g2", {})).verdict == "admissible"
    on = body("17/10", 1)
    texts = {"pp": "w", "mp": "log(-w)", "pm": "log(-w)", "mm": "log(-w)"}
    assert decide(on, general_potential(on, texts, "0", {})).verdict == "admissible"


@pytest.mark.parametrize("F", ["log(-w)", "sqrt(w - 10^9)"])
def test_a_potential_without_values_is_an_error(F):
    on = body("17/10", 1)
    with pytest.raises(UndefinedPotentialError) as caught:
        decide(on, general_potential(on, F, "g2", {}))
    assert caught.value.pointer == "/potential"


def test_equal_moments_are_refused():
    V = general_potential(body(3, 1), "w", "g2", {})
    with pytest.raises(EqualMomentsError):
        decide(body(2, 2), V)
