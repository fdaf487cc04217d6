"""The pieces on which a formula is analytic are all found, and a proof on all of them is needed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.equations.compatibility import residual_ball
from service.dynamics.formula.algebras.real import RealAlgebra
from service.dynamics.verdict.piecewise import find_pieces
from service.dynamics.verdict.sphere.switches import Switches, find_switches, normalise
from service.dynamics.verdict.verdict import UndefinedPotentialError
from tests.dynamics.verdict.formulas import body, potential, verdict_on
from tests.support.effort import examples

Q = "(2*g1^2 + g3^2)"

ARGUMENTS = [
    "g2 - 99/100",
    "g2 + g1/3 - 1/7",
    "g1*g3 - g2^2 + 1/9",
    "exp(g2) - 2",
    "g1^2 - g3^2",
    "g1 - sqrt(g1^2 + g3^2)/2",
    "sin(7*g2)",
    "log(g1 + 2) - g3",
]


def sphere(count: int) -> np.ndarray:
    """Return points all over the sphere, equally dense, shape (count, 3)."""
    k = np.arange(count) + 0.5
    height, angle = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(angle), height, across * np.sin(angle)], axis=1)


def signs_at(switches: Switches, gamma: np.ndarray) -> set[tuple[int, ...]]:
    values = [
        switches.argument(number).evaluate(RealAlgebra(), tuple(gamma.T))
        for number in range(len(switches.absolutes))
    ]
    # Closer to a line than doubles tell there is no sign.
    columns = np.stack([np.broadcast_to(value, len(gamma)) for value in values])
    return {tuple(int(s) for s in np.sign(column)) for column in columns.T if np.abs(column).min() > 1e-12}


@settings(max_examples=examples(8, 25), deadline=None)
@given(chosen=st.lists(st.sampled_from(ARGUMENTS), min_size=1, max_size=3, unique=True))
def test_every_combination_of_signs_that_dense_points_show_is_among_the_pieces(chosen):
    text = " + ".join(f"abs({argument})" for argument in chosen)
    switches = find_switches(potential(text).tape)
    pieces = find_pieces(switches, lambda: False)
    met = signs_at(switches, sphere(20_000))
    assert met <= set(pieces.all)
    # What is said to have been met at a point was met there.
    for signs, points in pieces.points.items():
        assert signs in signs_at(switches, np.array(points, dtype=np.float64))


@pytest.mark.parametrize("size", ["1e-2", "1e-4", "1e-6", "1e-8"])
def test_a_cap_of_any_size_is_a_piece(size):
    switches = find_switches(potential(f"abs(g2 - 1 + {size})").tape)
    assert set(find_pieces(switches, lambda: False).points) == {(1,), (-1,)}


def test_a_sign_that_never_changes_makes_one_piece():
    switches = find_switches(potential("abs(g1 + 3) + abs(g1*g3 - 2)").tape)
    assert set(find_pieces(switches, lambda: False).all) == {(1, -1)}


@pytest.mark.parametrize(
    ("text", "absolutes"),
    [
        ("sqrt((g1 - g3)^2)", 1),
        ("sqrt(g1^2 - 2*g1*g3 + g3^2)", 1),
        ("sqrt(1 - g2^2 - 2*g1*g3)", 1),  # the same on the sphere
        ("abs(g1^2 - g3^2)", 2),
        ("abs(g1 - g3) + abs(3*g3 - 3*g1)", 1),
        ("log((g2 - 1/3)^2)", 1),
        ("((g2 - 1/3)^3*(2 + g1))^(1/2)", 1),
        ("(exp(g2) - 2)^2^(1/4)", 0),
        ("((exp(g2) - 2)^2)^(1/4)", 1),
        ("abs(g1*g3)", 0),  # the octants are parted there
        ("sqrt(g1^2 + g3^2)*(1 - g2^2)^0.7", 0),
    ],
)
def test_hidden_absolute_values_are_found_and_the_values_stay(text, absolutes):
    tape = potential(text).tape
    switches = find_switches(tape)
    assert len(switches.absolutes) == absolutes
    gamma = sphere(500)
    with np.errstate(all="ignore"):
        before = np.broadcast_to(tape.evaluate(RealAlgebra(), tuple(gamma.T)), 500)
        after = np.broadcast_to(normalise(tape).evaluate(RealAlgebra(), tuple(gamma.T)), 500)
    known = np.isfinite(before) & np.isfinite(after)
    assert known.any()
    # Some roundings, and of a square root of a square next to 0 its root: 1e-16^(1/2).
    assert np.abs(before - after)[known].max() < 1e-7


@settings(max_examples=examples(7, 20), deadline=None)
@given(chosen=st.lists(st.sampled_from(ARGUMENTS), min_size=1, max_size=2, unique=True), data=st.data())
def test_on_a_piece_the_formula_is_its_rewritten_self(chosen, data):
    text = "g1 + " + "*".join(f"(abs({argument}) + g3)" for argument in chosen)
    tape = potential(text).tape
    switches = find_switches(tape)
    pieces = find_pieces(switches, lambda: False)
    signs = data.draw(st.sampled_from(sorted(pieces.points)))
    gamma = np.array(pieces.points[signs], dtype=np.float64)
    whole = tape.evaluate(RealAlgebra(), tuple(gamma.T))
    here = switches.on_piece(signs).evaluate(RealAlgebra(), tuple(gamma.T))
    # The same operations up to signs, of numbers of order 1.
    assert np.allclose(whole, here, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "-g1 + (abs(g2 - 99/100) + g2 - 99/100)^3*g1*g3*1000",
        "-g1 + (abs(g2 - 1 + 1e-7) + g2 - 1 + 1e-7)*g1*g3",
        "-g1 + (sqrt((g1 + g3 - 7/5)^2) + g1 + g3 - 7/5)^4*g2",
    ],
)
def test_what_is_not_admissible_in_a_small_cap_only_is_refuted_there(text):
    verdict = verdict_on(text)
    assert (verdict.verdict, verdict.proof) == ("inadmissible", "counterexample")
    example = verdict.counterexample
    assert example is not None
    assert sum(g * g for g in example.g) == 1
    assert not residual_ball(body(2), potential(text).tape, example.g).residual.contains(0)


@pytest.mark.parametrize("alpha", ["2", "17/10"])
@pytest.mark.parametrize(
    "G",
    [
        "(abs(g2 - 99/100) + g2 - 99/100)^3",
        "sqrt((g2^2 - 1/4)^2)",
        "log((g2 - 1/3)^2)",
        "((g2 + 1/2)^2)^(2/3)",
        "abs(sin(7*g2))",
        "abs(exp(g2) - 2)*(abs(g2 - 1/3) - g2)",
        "abs(g2)",
    ],
)
def test_kinks_in_g2_alone_are_admissible_and_proved(G, alpha):
    verdict = verdict_on(f"(A*g1^2 + C*g3^2)*({G}) + 5", body(alpha))
    assert (verdict.verdict, verdict.proof) == ("admissible", "symbolic")


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "text",
    [
        "0*sqrt(-1 - g1^2)",
        "g1 + 0*sqrt(-1 - g1^2)",
        "g1 + 0/(g1 - g1)",
        "g1 + sqrt(-1 - g1^2)^0",
        "g1*1^log(-1 - g2^2)",
        "log(g1 - 1/2) + 0*log(-g1)",
    ],
)
def test_what_has_no_value_has_none_times_0(text):
    with pytest.raises(UndefinedPotentialError, match="no finite value"):
        verdict_on(text)


@pytest.mark.parametrize("text", ["g1 + 0/g3^2", "g1 + 0*log(g1 - 0.999999)", "g1 + 0*abs(g2)^(1/3)", "0*g2"])
def test_what_has_a_value_somewhere_is_nothing_times_0(text):
    assert verdict_on(text).verdict == "admissible"


def test_when_it_is_late_nothing_is_claimed():
    late = verdict_on("-g1 + (abs(g2 - 99/100) + g2 - 99/100)^3*g1*g3*1000", is_late=lambda: True)
    assert late.verdict == "undecided"
