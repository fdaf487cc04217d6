"""Searches of numbers: what theory and certified periods say must be found, enclosed, and nothing else."""

import json
from fractions import Fraction

import pytest
from flint import arb, ctx

from service.dynamics.formula.algebras.ball import ball
from service.schemas.study.reading import read_search
from service.storage.codecs.packing import decode_document
from workers.computation.studies import family_of, study_document
from workers.solvers.certified.certify import certify
from workers.solvers.searches.search import FamilySearch, Target, _Search
from workers.solvers.searches.structure import stretches
from workers.solvers.stability.monodromy import transverse_stability

HEAVY = {"type": "expression", "expression": "a*g1", "parameters": {"a": -1}}
ROUND = {"body": {"A": 2, "C": 1}, "potential": HEAVY, "motion": {"type": "planar", "lambda": 1}}
"""Bobylev's and Steklov's case, whose motion goes round the loop through both poles."""
SWINGING = {**ROUND, "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"}}
PERIOD = "6.432310535121612579869958267408499"
"""T for a = −1, C = 1, λ = 1, to 33 digits (theory 2.4)."""


def found(base, unknowns, wanted, tell=bool):
    asked = {
        "base": base,
        "unknowns": [{"pointer": pointer, "interval": list(ends)} for pointer, ends in unknowns.items()],
        "wanted": [{"of": of, "equals": equals} for of, equals in wanted.items()],
    }
    read_search(asked)
    return decode_document(study_document(json.dumps({"what": "numbers", **asked}), tell).data)


def only_one(answer, **expected):
    """Check that there is one solution, proved, whose radii have the expected numbers inside."""
    (solution,) = answer["solutions"]
    assert solution["proof"] == "proved"
    for name, (value, error) in expected.items():
        (told,) = (each for pointer, each in solution["values"].items() if pointer.endswith(f"/{name}"))
        off = abs(Fraction(told["value"]) - value)
        # What is expected is known to so many digits itself.
        assert off <= Fraction(told["radius"]) + error
        assert Fraction(told["radius"]) < Fraction(1, 10**18)


def test_a_parameter_with_a_given_period_is_enclosed():
    # T is a multiple of (−a)^(−1/2): 33 digits of T are as many of a.
    answer = found(ROUND, {"/potential/parameters/a": ("-21/20", "-19/20")}, {"period": PERIOD})
    only_one(answer, a=(-1, Fraction(1, 10**32)))
    assert (answer["rest"], answer["undecided"]) == ("proved_empty", [])


def test_lambda_with_a_given_period_is_enclosed_and_the_rest_is_empty():
    told = []
    answer = found(
        SWINGING, {"/motion/lambda": ("49/50", "51/50")}, {"period": "6.34007793723281"}, told.append
    )
    # The share of the interval that is settled.
    assert told == sorted(told)
    assert (told[0] > 0.0, told[-1]) == (True, pytest.approx(1.0))
    # The 15 digits are those of theory 1.6; dT/dλ = −1.6.
    only_one(answer, **{"lambda": (1, Fraction(1, 10**14))})
    assert (answer["rest"], answer["undecided"]) == ("proved_empty", [])
    nothing = found(SWINGING, {"/motion/lambda": ("49/50", "51/50")}, {"period": 7})
    assert (nothing["solutions"], nothing["rest"]) == ([], "proved_empty")


def test_two_unknowns_with_a_given_period_and_energy_are_enclosed():
    unknowns = {"/motion/lambda": ("99/100", "101/100"), "/potential/parameters/a": ("-101/100", "-99/100")}
    # h = −a λ²/2 (theory 2.4).
    answer = found(ROUND, unknowns, {"period": PERIOD, "energy": "1/2"})
    only_one(answer, **{"lambda": (1, Fraction(1, 10**31)), "a": (-1, Fraction(1, 10**31))})
    assert answer["rest"] == "proved_empty"


def test_a_precession_that_is_wanted_is_that_of_a_solution():
    # Δψ1 in a full period for nu = λ² = 1 (theory 7).
    wanted = {"precession.psi1": "3.61050523508724966610354854487"}
    answer = found(ROUND, {"/motion/lambda": ("99/100", "101/100")}, wanted)
    only_one(answer, **{"lambda": (1, Fraction(1, 10**28))})
    assert answer["rest"] == "proved_empty"


@pytest.mark.long  # a box in A is cut often: half a minute
def test_a_moment_with_a_given_period_is_enclosed_where_the_formula_is_admissible_for_all():
    base = {
        "body": {"A": 3, "C": 1},
        "potential": {"type": "expression", "expression": "(A*g1^2 + C*g3^2)*(g2^2 - 1/2 + g2^3/5)"},
        "motion": {"type": "planar", "lambda": "4/5"},
    }
    # T for A = 3 to 35 digits (theory 11, G10).
    wanted = {"period": "6.55593813374157484500337478933646021"}
    only_one(found(base, {"/body/A": ("299/100", "301/100")}, wanted), A=(3, Fraction(1, 10**30)))


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("pointer", "ends", "at"),
    [
        # The upper edge of the band, B* = 2νC / (2ν − |x2|) with x2 = −ν/2 − √(ν²/4 + 1) (theory 8).
        ("/body/B", ("12/5", "13/5"), lambda B: (Fraction(2), B)),
        ("/motion/nu", ("19/10", "21/10"), lambda nu: (nu, Fraction(5, 2))),
    ],
)
def test_a_change_of_stability_is_proved_by_traces_on_both_sides_of_it(pointer, ends, at):
    """The trace of Bobylev's and Steklov's motions is that of Lamé's equation, in theta functions."""
    base = {**ROUND, "body": {"A": 2, "B": "5/2", "C": 1}, "motion": {"type": "planar", "nu": 2}}
    (solution,) = found(base, {pointer: ends}, {"trace": 2})["solutions"]
    value, radius = (Fraction(solution["values"][pointer][name]) for name in ("value", "radius"))
    # The enclosed traces have radii of 1e-9, and change faster than the unknown.
    assert (solution["proof"], radius < Fraction(1, 10**8)) == ("proved", True)
    with ctx.workprec(128):
        below, above = (transverse_stability(*at(value + sign * radius)).trace - 2 for sign in (-1, 1))
        assert below * above < 0
        if pointer == "/body/B":
            edge = 4 / (4 - (1 + arb(2).sqrt()))
            assert abs(edge - ball(value)) < ball(radius)


@pytest.mark.parametrize(
    ("potential", "rest"),
    [
        # h = B λ²/2 at λ = 1.
        ("-B*g1", "proved_empty"),
        # In the middle it is admissible, and nowhere else.
        ("-g1 + (B - 2)*g1^2", "undecided"),
    ],
)
def test_a_moment_that_the_potential_has_in_it_changes_the_potential(potential, rest):
    field = {"type": "expression", "expression": potential}
    answer = found({**ROUND, "potential": field}, {"/body/B": ("3/2", "5/2")}, {"energy": "23/20"})
    assert answer["rest"] == rest
    if rest == "proved_empty":
        only_one(answer, B=(Fraction(23, 10), 0))
    else:
        assert all(each["proof"] == "possible" for each in answer["solutions"])


@pytest.mark.parametrize(
    ("potential", "body", "ends", "stay"),
    [
        ("-g1 + 1/(20*g3^2) + c*(g1^2 - g2^2)", {"A": 2, "C": 1}, (1, "6/5"), True),
        # The window vanishes at c = 5/4 (theory, S3).
        ("-g1 + 1/(20*g3^2) + c*(g1^2 - g2^2)", {"A": 2, "C": 1}, ("6/5", "13/10"), False),
        # Motions through both poles, at which the second V has no second derivative (theory 2.4).
        ("-c*g1*(4*g1^2 + 3*g3^2)", {"A": 4, "C": 1}, (1, "6/5"), True),
        ("-c*abs(g1)^(4/3)", {"A": 3, "C": 1}, (1, "6/5"), False),
    ],
)
def test_motions_stay_where_windows_do_and_the_potential_is_analytic_on_their_way(
    potential, body, ends, stay
):
    field = {"type": "expression", "expression": potential, "parameters": {"c": 1}}
    base = {"body": body, "potential": field, "motion": {"type": "planar", "lambda": 1}}
    unknown = {"pointer": "/potential/parameters/c", "interval": list(ends)}
    asked = read_search({"base": base, "unknowns": [unknown], "wanted": [{"of": "energy", "equals": 0}]})
    (place,) = asked.unknowns
    question = FamilySearch(family_of(asked, asked.problem_at([place.middle])), asked.problem_at, [], bool)
    assert question.motions_stay(((place.lower, place.upper),)) is stay


SHRINKING = {
    **ROUND,
    "potential": {
        "type": "expression",
        "expression": "-g1 + 1/(20*g3^2) + c*(g1^2 - g2^2)",
        "parameters": {"c": 1},
    },
}


def test_boxes_on_which_windows_stay_end_where_a_window_shrinks_to_an_equilibrium():
    # With A = 2C, a1 = -1, b1 = 1/20 and ν = 1 there is a window up to c1 = a1² / (16 b1) = 5/4 (theory, S3).
    unknown = {"pointer": "/potential/parameters/c", "interval": [1, "3/2"]}
    asked = read_search({"base": SHRINKING, "unknowns": [unknown], "wanted": [{"of": "energy", "equals": 0}]})
    question = FamilySearch(
        family_of(asked, asked.problem_at([Fraction(1)])), asked.problem_at, [Target("energy", arb)], bool
    )
    with ctx.workprec(96):
        kept, rest = stretches(question.family, ((Fraction(1), Fraction(3, 2)),), bool)
    (((lower, upper),),) = rest
    assert lower < Fraction(5, 4) < upper
    # The box is halved 18 times; next to the change a few halves are not settled.
    assert upper - lower < Fraction(1, 10**4)
    assert [(box[0][0], box[0][1]) for box in kept] == [(1, lower), (upper, Fraction(3, 2))]
    for ((low, high),), count in zip(kept, (1, 0), strict=True):
        for k in range(5):
            assert len(question.arcs_at([low + (high - low) * Fraction(k, 4)])) == count


@pytest.mark.parametrize("base", [ROUND, SWINGING], ids=["round", "swinging"])
def test_certified_periods_lie_within_what_is_bounded(base):
    """On a box about λ = 1, by elliptic functions, which the bounds do not use."""
    unknown = {"pointer": "/motion/lambda", "interval": ["19/20", "21/20"]}
    asked = read_search({"base": base, "unknowns": [unknown], "wanted": [{"of": "energy", "equals": 0}]})
    problem = asked.problem_at([Fraction(1)])
    question = FamilySearch(family_of(asked, problem), asked.problem_at, [Target("period", arb)], bool)
    with ctx.workprec(96):
        ((window, arc),) = _Search(question, ((Fraction(19, 20), Fraction(21, 20)),))._windows([Fraction(1)])
        search = _Search(question, ((Fraction(19, 20), Fraction(21, 20)),))
        (model,) = search._models(window, arc, [Fraction(1)], [Fraction(1, 50)])
        slopes = model.slopes([Fraction(1)], 40)
        within = slopes.range_on([arb(1) / 200])
        slope = slopes.gradient_on([arb(1) / 200])[0]
    before = None
    for k in range(-4, 5):
        at = 1 + Fraction(k, 800)
        there = asked.problem_at([at])
        period = certify(there.body, there.potential, there.motion, [], 96, methods=("elliptic",)).period
        assert within.contains(period)
        assert period < model.bound
        if before is not None:
            # The mean value theorem.
            assert slope.overlaps((period - before) * 800)
        before = period
