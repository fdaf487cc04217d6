"""The verdict proves what is admissible, refutes what is not, and never the other way round."""

from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import pytest
from flint import ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.equations.compatibility import residual_ball
from service.dynamics.errors import EqualMomentsError
from service.dynamics.verdict import verdict as verdict_module
from service.dynamics.verdict.verdict import UndefinedPotentialError, Verdict, decide
from tests.dynamics.verdict.formulas import (
    EIGHT_PARAMETERS,
    EIGHT_TERMS,
    B_term,
    C_term,
    U,
    W,
    body,
    potential,
    verdict_on,
)
from tests.support.effort import examples

ALPHAS = [Fraction(17, 10), Fraction(3), Fraction(3, 5), Fraction(5, 2), Fraction(2, 7)]
TINY = Fraction(1, 10**30)


def is_proved(verdict: Verdict) -> bool:
    return verdict.verdict == "admissible" and verdict.proof == "symbolic"


def is_refuted(verdict: Verdict) -> bool:
    return verdict.verdict == "inadmissible" and verdict.counterexample is not None


def test_the_eight_term_potential_of_the_paper_is_proved():
    assert is_proved(verdict_on(EIGHT_TERMS, parameters=EIGHT_PARAMETERS))


def test_the_eight_term_potential_is_decided_by_algebra_after_a_look_at_few_points(monkeypatch):
    """Hence at once: enclosures at many points and in many bits are what takes long."""
    looks, survey = [], verdict_module.survey

    def counted(body, tape, points, *, bits):
        looks.append((chosen := list(points), bits))
        return survey(body, tape, chosen, bits=bits)

    monkeypatch.setattr(verdict_module, "survey", counted)
    assert is_proved(decide(body(2), potential(EIGHT_TERMS, parameters=EIGHT_PARAMETERS)))
    ((points, bits),) = looks
    assert len(points) == verdict_module.FIRST_POINTS
    assert bits == verdict_module.PRECISIONS[0]


def test_the_printed_a3_term_is_refuted():
    printed = EIGHT_TERMS.replace("- g3^8/g1^3", "+ g3^8/g1^3")
    assert is_refuted(verdict_on(printed, parameters=EIGHT_PARAMETERS))


@pytest.mark.one_in(3)
@pytest.mark.parametrize("n", range(1, 9))
def test_the_building_blocks_of_the_rational_family_are_proved(n):
    assert is_proved(verdict_on(U(n)))
    assert is_proved(verdict_on(W(n)))


@pytest.mark.one_in(4)
@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize("n", range(3))
def test_the_homogeneous_blocks_are_proved_for_any_ratio_of_moments(alpha, n):
    # C = 3 as well: only the ratio counts.
    for on in (body(alpha), body(3 * alpha, 3)):
        if (n + 1) / alpha not in range(1, n):  # theory 4.4: no B_n there
            assert is_proved(verdict_on(B_term(n, alpha), on))
        assert is_proved(verdict_on(C_term(n, alpha), on))


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    "G",
    [
        "sin(3*g2)",
        "exp(-g2^2)",
        "g2^5 - 7*g2 + 1/3",
        "1/(1 + g2)",
        "g2^2/(g2^2 - 3*g2 + 5)",
        "log(2 + g2)",
        "sqrt(2 - g2)",
        "tan(g2/2)",
        "abs(g2 - 1/3)",
        "(2 + g2)^g2",
        "(1 - g2^2)^0.7",
        "cos(exp(g2))",
        "g2^400",
        "pi^g2",
        "(2 + g2)^0.123456789012 - 1e-300",
    ],
)
@pytest.mark.parametrize("alpha", [Fraction(2), Fraction(17, 10), Fraction(3, 5)])
def test_q_times_any_function_of_g2_is_proved(G, alpha):
    assert is_proved(verdict_on(f"(A*g1^2 + C*g3^2)*({G}) + 5", body(alpha)))


@pytest.mark.parametrize(
    ("text", "alpha"),
    [
        ("(2*g1^2 + g3^2)*log(abs(g1)) + 2*(g1^2 + g3^2)", 2),  # theory 3.4
        (  # theory 4.5
            "16*(g1^2 + g3^2)*(3*g1^2 + g3^2)*log(abs(g1)) + 27*(g1^2 + g3^2)^2 - (3*g1^2 + g3^2)^2"
            " - 8*(g1^2 + g3^2)*(3*g1^2 + g3^2)*log(g1^2 + g3^2)",
            3,
        ),
        ("g1*(4*g1^2 + 3*g3^2)", 4),
        ("g1*(24*g1^4 + 40*g1^2*g3^2 + 15*g3^4)", 6),
        ("g3*(4*g3^2 + 3*g1^2)", Fraction(1, 4)),
        ("sqrt(2)*g1 + pi*log(3)/g3^2 + 2^(1/3)*exp(1/2)*g1", 2),
        ("sqrt(g1)^2", 2),
        ("exp(4/3*log(abs(g1)))", 3),
        ("sqrt(-g1*g1^3*(g1^2 + g3^2 - 1))*0 + sqrt(g2^2)*(2*g1^2 + g3^2)", 2),
        ("exp(g1*g3)*g1*exp(-g3*g1)", 2),
        ("sqrt(2 + g1)*g1/(2 + g1)^(1/2)", 2),
        ("g1*sin(g3)^2 + g1*cos(g3)^2", 2),
        ("g1*(g1 - g2)/(g1^2 - g2^2)*(g1 + g2)", 2),
    ],
)
def test_roots_logarithms_and_constants_are_proved(text, alpha):
    assert is_proved(verdict_on(text, body(alpha)))


@pytest.mark.parametrize(
    ("text", "alpha"),
    [
        ("g2", 2),
        ("g1", 3),
        ("g1*g2", 2),
        ("g3", 2),
        ("abs(g1)^(4/3) + g1/100", 3),
        ("exp(g1)", 2),
        ("(2*g1^2 + g3^2)*log(abs(g1))", 2),
        ("(2*g1^2 + g3^2)*sin(g2 + g1)", 2),
        ("exp(-1e10*g1^2)*1e-200", 2),
        ("log(g1 - 0.97)", 2),  # defined on a small cap only
        ("g1 + g1*(abs(g2 + g3) + g2 + g3)", 2),  # admissible in a part of the sphere only
    ],
)
def test_what_is_not_admissible_is_refuted(text, alpha):
    assert is_refuted(verdict_on(text, body(alpha)))


def test_a_counterexample_is_on_the_sphere_and_its_ball_is_true():
    on, text = body("17/10"), "g1^2*g3 + g2/7"
    example = verdict_on(text, on).counterexample
    assert example is not None
    assert sum(g * g for g in example.g) == 1
    mid, rad = Fraction(Decimal(example.residual.mid)), Fraction(Decimal(example.residual.rad))
    assert abs(mid) > rad
    with ctx.workprec(1000):
        sharper = residual_ball(on, potential(text, on).tape, example.g).residual
        low, high = (Fraction(int(x.p), int(x.q)) for x in map(_exact, (sharper.lower(), sharper.upper())))
    assert mid - rad <= low <= high <= mid + rad


def _exact(end):
    return end.fmpq()


@settings(max_examples=examples(8, 25), deadline=None)
@given(name=st.sampled_from(["a3", "b2", "b3", "a2"]), sign=st.sampled_from([-1, 1]), place=st.integers(0, 5))
def test_a_perturbation_by_1e_30_is_still_refuted(name, sign, place):
    # One coefficient inside a block, not the free amplitude in front of it.
    spots = {
        "a2": ["8*g1^3", "8*g1*g3^2", "g3^4/g1"],
        "a3": ["9*g3^4", "16*g3^6/g1", "g3^8/g1^3", "16*g1^2*g3^2", "8*g1^4"],
        "b2": ["g1^2 - g3^2)/g3^6"],
        "b3": ["2*g1^4", "2*g1^2*g3^2 + g3^4)/g3^10"],
    }[name]
    spot = spots[place % len(spots)]
    assert EIGHT_TERMS.count(spot) == 1
    perturbed = EIGHT_TERMS.replace(spot, f"(1 + e)*{spot}")
    parameters = {**EIGHT_PARAMETERS, "e": sign * TINY}
    assert is_refuted(verdict_on(perturbed, parameters=parameters))
    assert is_proved(verdict_on(perturbed, parameters={**parameters, "e": Fraction(0)}))


@pytest.mark.parametrize("exponent", [30, 100, 300])
def test_a_perturbation_hidden_by_large_terms_is_refuted(exponent):
    text = f"1e50*(A*g1^2 + C*g3^2)*sin(g2) + 1e-{exponent}*g1*g2"
    assert is_refuted(verdict_on(text))


@pytest.mark.parametrize("W_text", ["exp(g1*g3)", "g2^3/(2 + g1)", "abs(g1)^(1/3)"])
@pytest.mark.parametrize("V_text", [EIGHT_TERMS, "g1*g2 + g3"])
def test_potentials_that_agree_on_the_sphere_get_the_same_verdict(V_text, W_text):
    R = "(g1^2 + g2^2 + g3^2)"
    plain = verdict_on(V_text, parameters=EIGHT_PARAMETERS)
    added = verdict_on(f"{V_text} + ({R} - 1)*{W_text}", parameters=EIGHT_PARAMETERS)
    scaled = verdict_on(f"({V_text})*{R}^2", parameters=EIGHT_PARAMETERS)
    assert (plain.verdict, plain.proof) == (added.verdict, added.proof) == (scaled.verdict, scaled.proof)
    assert plain.energy_formula == added.energy_formula == scaled.energy_formula


@settings(max_examples=examples(5, 30), deadline=None)
@given(
    coefficients=st.lists(st.fractions(-3, 3, max_denominator=20), min_size=4, max_size=4),
    extra=st.sampled_from(["0", "g1^2*g2", "g3^3", "g1^2"]),
)
def test_the_mirror_image_gets_the_same_verdict(coefficients, extra):
    # Exchanging A with C and g1 with g3 keeps admissibility.
    a, b, c, d = (f"({x})" for x in coefficients)
    V = f"{a}*g1 + {b}/g3^2 + {c}*(g1^2 - g2^2) + {d}*g2*(2*g1^2 + g3^2) + {extra}"
    swapped = V.replace("g1", "gx").replace("g3", "g1").replace("gx", "g3")
    one, other = verdict_on(V, body(2)), verdict_on(swapped, body(1, 2))
    assert one.verdict == other.verdict == ("admissible" if extra == "0" else "inadmissible")


def test_a_hidden_relation_between_functions_leaves_numeric_evidence():
    # (1 + sqrt(w))^3 written out, w = 2 + g1 g3: no exact rule finds its cube root.
    w = "(2 + g1*g3)"
    verdict = verdict_on(f"g1 + (1 + 3*{w} + (3 + {w})*sqrt({w}))^(1/3) - 1 - sqrt({w})")
    assert (verdict.verdict, verdict.proof) == ("undecided", "numeric")
    assert verdict.evidence is not None
    assert verdict.evidence.points == 48
    assert verdict.evidence.bits == 4096


@pytest.mark.parametrize(
    "text", ["log(-1 - g1^2)", "(2*g1^2 + g3^2)*sqrt(-2 - g2)", "1/(g1^2 + g2^2 + g3^2 - 1)"]
)
def test_a_potential_that_is_nowhere_defined_is_refused(text):
    with pytest.raises(UndefinedPotentialError, match="no finite value"):
        verdict_on(text)


def test_equal_moments_are_refused():
    on = replace(body(2), C=Fraction(2))
    with pytest.raises(EqualMomentsError):
        verdict_on("g1", on)


@pytest.mark.parametrize(
    "text",
    [
        " + ".join(f"(2*g1^2 + g3^2)*g2^{k}*sin({k}*g2 + {k})" for k in range(1, 40)),
        "g1*(1 + g1 + g2 + g3)^60/(1 + g1 + g2 + g3)^60",
    ],
)
def test_long_sums_and_powers_that_cancel_are_proved(text):
    verdict = verdict_on(text)
    assert (verdict.verdict, verdict.proof) == ("admissible", "symbolic")


def test_a_formula_too_large_for_a_proof_is_undecided():
    # On the sphere the second base is the square of the first: both powers have to be written out.
    text = "(1 + g1 + g2 + g3)^64 - (2 + 2*g1 + 2*g2 + 2*g3 + 2*g1*g2 + 2*g1*g3 + 2*g2*g3)^32"
    assert verdict_on(f"g1 + {text}").verdict == "undecided"


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "text",
    [
        # Numbers that no memory holds: flint would abort the whole process on them.
        "(2*g1^2 + g3^2)*((((3*g2)^1000)^1000)^1000)^1000",
        "(2*g1^2 + g3^2)*exp(1e300*log(2 + g2*0)*g2^0) + g1",
        "(2*g1^2 + g3^2)*(3*abs(g2))^(pi*1e300/pi)",
        "(2*g1^2 + g3^2)*2^(g2*1e300)",
        "(2*g1^2 + g3^2)*sqrt((2^1000*abs(g2)/3)^999)",
        "(2*g1^2 + g3^2)*(1/((1 + 1e-300*g2)^1000)^1000)",
        "(2*g1^2 + g3^2)/(((g2^1000)^1000)^1000 + 2) + g1",
        "(2*g1^2 + g3^2)*g2 + 0.5/(((g1^1000)^1000)^1000 + 2) - 1/(2*((g1^1000)^1000)^1000 + 4)",
    ],
)
def test_numbers_that_would_explode_end_the_proof_not_the_process(text):
    assert verdict_on(text).verdict in ("admissible", "undecided")
