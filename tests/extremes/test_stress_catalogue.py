"""The stress catalogue: each row at its exact parameters, with its printed numbers where it has some.

Periods are printed for one trip of g1; all six variables take two, except
between two rest points. Numbers are compared within what the answers claim and
half a unit of their last printed digit.
"""

import json
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from service.jobs.records import Solved
from service.storage.codecs.packing import decode_arrays
from tests.extremes.elliptic import elliptic
from tests.extremes.problems import METHODS, SEPARATRIX, Answer, require_claims, solve, three_terms
from tests.support.effort import each_once
from workers.computation.compute import solve_checked

ONE_PERIOD = {"periods": 1, "samples": 9}
SHORT = {"start": 0, "stop": "3/4", "samples": 4}
NU_1 = Fraction(1)


def require_period(answer, trip: str, trips: int = 2) -> None:
    assert answer.code is None, answer.code
    with ctx.workprec(200):
        # The last digit is cut off in some of them, and rounded in others.
        printed = arb(trip, 10.0 ** -len(trip.partition(".")[2]))
        assert abs(trips * printed - arb(answer.period)).lower() <= answer.period_error


@each_once(
    method=METHODS,
    e__above__below=[
        ("1e-4", "11.638532474857046576440278424317", "11.638885132792138979913441573607"),
        ("1e-8", "20.349310886348759051770962717948", "20.349310953129807035130065835465"),
        ("1e-12", "29.059913042594031986693570834465", "29.059913042603861616946205069781"),
    ],
)
def test_s1_next_to_the_separatrix_between_rest_and_equator(method, e, above, below):
    for sign, trip, ends in ((1, above, ["pole", "rest"]), (-1, below, ["pole", "equator"])):
        c1 = rounded(SEPARATRIX * (1 + sign * Fraction(e)))
        answer = three_terms(-1, 0, c1, 1, ONE_PERIOD, method=method)
        require_period(answer, trip)
        assert list(answer.summary["window"]["ends"]) == ends
        require_claims(answer, elliptic("PW" if sign > 0 else "PE", nu=NU_1, a1=-NU_1, b1=Fraction(0), c1=c1))


def test_s1_on_the_separatrix_there_is_no_period_but_an_asymptote():
    on_it, motion = "-g1 + (1+sqrt(5))/4*(g1^2-g2^2)", {"nu": 1, "start": {"g1": "1/2"}}
    assert solve(on_it, {"nu": 1}, SHORT).code == "start_needed"
    assert solve(on_it, motion, ONE_PERIOD).code == "period_needed"
    answer = solve(on_it, motion, {"start": 0, "stop": "1e6", "samples": 3})
    assert answer.code is None
    assert answer.summary["aperiodic"] == "separatrix"
    future = answer.summary["asymptotes"]["future"]
    assert future["kind"] == "equilibrium"
    assert future["time"] is None
    # The slope of the periods, (2/mu) ln(1/e), has mu = √(2√5): gaps go like squares of distances.
    assert abs(future["rate"]["value"] - np.sqrt(2 * np.sqrt(5)) / 2) <= future["rate"]["error"] + 1e-15
    assert abs(answer.states[-1, 3] - (np.sqrt(5) - 1) / 2) <= answer.error


@each_once(
    method=METHODS,
    e__positive__negative=[
        ("1e-4", "11.871480718662403458321120528318", "11.871233934728635386542107047566"),
        ("1e-8", "21.08169771438716410201869202005", "21.081697666682919875681085871596"),
        ("1e-12", "30.292038062514761072759494624699", "30.292038062507688063243866818557"),
    ],
)
def test_s2_next_to_the_separatrix_at_the_pole(method, e, positive, negative):
    for sign, trip, ends in ((1, positive, "WE"), (-1, negative, "PE")):
        a1 = sign * Fraction(e)
        answer = three_terms(a1, 0, -1, 1, ONE_PERIOD, method=method)
        require_period(answer, trip)
        require_claims(answer, elliptic(ends, nu=NU_1, a1=a1, b1=Fraction(0), c1=-NU_1))
        if sign > 0:
            # lo = a1/2: 2 c1 x² = −a1 x.
            assert answer.summary["window"]["g1"][0] == pytest.approx(float(a1) / 2, rel=1e-15)


@pytest.mark.one_in(4)
@pytest.mark.parametrize("tier", ["standard", "draft", "high", "certified"])
def test_s2_where_doubles_do_not_know_the_period_enclosures_have_it_and_the_times(tier):
    """T is about 696; the closed form in doubles has 328, and claims an error of 57."""
    document = {
        "body": {"A": 2, "C": 1},
        "potential": {"type": "expression", "expression": "1e-150*g1 - (g1^2-g2^2)"},
        "motion": {"type": "planar", "nu": 1},
        "time": ONE_PERIOD,
        "accuracy": {"tier": tier},
    }
    found = solve_checked(json.dumps(document))
    assert isinstance(found, Solved), found.error
    answer = Answer(None, found.summary, decode_arrays(found.samples), ONE_PERIOD)
    if tier == "certified":
        radius = float(found.summary["period"]["radius"])
        # The decimal becomes a double.
        answer.summary["period"] = {"value": float(found.summary["period"]["value"]), "error": radius + 1e-13}
    require_claims(answer, elliptic("WE", nu=NU_1, a1=Fraction("1e-150"), b1=Fraction(0), c1=-NU_1))


def test_s2_at_the_separatrix_the_pole_is_never_reached():
    assert three_terms(0, 0, -1, 1, ONE_PERIOD).code == "period_needed"
    answer = three_terms(0, 0, -1, 1, {"start": 0, "stop": "1e6", "samples": 2})
    assert answer.summary["aperiodic"] == "pole"
    assert answer.summary["asymptotes"]["future"]["time"] is None
    assert np.abs(answer.states[-1] - [0, 0, 0, 0, -1, 0]).max() <= answer.error


@pytest.mark.parametrize("method", METHODS)
def test_s3_a_stable_equilibrium_and_small_librations_about_it(method):
    b1, c1 = Fraction(1, 20), Fraction(5, 4)
    answer = three_terms(-1, b1, c1, 1, SHORT, method=method)
    assert answer.summary["aperiodic"] == "equilibrium"
    assert np.abs(answer.columns["g1"] - 0.2).max() <= answer.error
    near = c1 * (1 - Fraction("1e-6"))
    librating = three_terms(-1, b1, near, 1, ONE_PERIOD, method=method)
    require_period(librating, "3.2232083834488599112487521787543", trips=1)
    require_claims(librating, elliptic("WW", nu=NU_1, a1=-NU_1, b1=b1, c1=near))
    # T → T0 like the square root of the gap and better; at 1e-40 no digit is left of the difference.
    limit = three_terms(-1, b1, c1 * (1 - Fraction("1e-40")), 1, ONE_PERIOD, method=method)
    require_period(limit, "3.2232060536528824315284202729299", trips=1)
    assert three_terms(-1, b1, c1 * (1 + Fraction("1e-6")), 1, SHORT, method=method).code == "no_motion"


@pytest.mark.one_in(2)
@each_once(
    method=METHODS,
    e__trip=[("1e-4", "8.311505408414688543587259"), ("1e-8", "13.86549833483549517550928")],
)
def test_s4_between_a_collision_and_an_oscillation(method, e, trip):
    b1 = -(1 - Fraction(e)) / 16
    answer = three_terms(1, b1, -1, 1, ONE_PERIOD, method=method, window=1)
    require_period(answer, trip)
    require_claims(answer, elliptic("WE", nu=NU_1, a1=NU_1, b1=b1, c1=-NU_1))
    falling = three_terms(1, -(1 + Fraction(e)) / 16, -1, 1, SHORT, method=method)
    assert falling.summary["aperiodic"] == "collision"


def test_s4_on_the_separatrix_x_tends_to_a_quarter():
    answer = three_terms(1, "-1/16", -1, 1, {"start": 0, "stop": "1e6", "samples": 2}, window=1)
    assert answer.summary["aperiodic"] == "separatrix"
    assert abs(answer.states[-1, 3] - 0.25) <= answer.error
    assert three_terms(1, "-1/16", -1, 1, ONE_PERIOD, window=1).code == "period_needed"


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("b1", "arrival"),
    [("-1/20", "1.06647559407919763218981408942"), ("-1/5", "0.82119911108083424708898369890624")],
)
def test_s5_a_collision_is_told_with_its_time(b1, arrival):
    answer = three_terms(-1, b1, "-1/2", 1, SHORT)
    future = answer.summary["asymptotes"]["future"]
    assert answer.summary["aperiodic"] == future["kind"] == "collision"
    assert abs(float(arrival) - future["time"]["value"]) <= future["time"]["error"]
    assert answer.summary["period"] is None
    assert three_terms(-1, b1, "-1/2", 1, ONE_PERIOD).code == "period_needed"
    assert three_terms(-1, b1, "-1/2", 1, {"times": [2]}).code == "motion_ended"


@each_once(
    method=METHODS,
    nu__trip__tolerance=[
        ("1e-6", "3.7081489309960855602505391838343", "1e-10"),
        ("1e-12", "3.7081493546023202303253035889675", "1e-10"),
        # r grows like √nu and its error with it: in doubles 1e-10 is met up to nu = 1e10.
        ("1e6", "0.0044428829381550340848122695044803", "1e-10"),
        ("1e12", "0.0000044428829381583662470158", "1e-8"),
    ],
)
def test_s6_narrow_and_wide_curves(method, nu, trip, tolerance):
    answer = three_terms(-1, 0, 0, nu, ONE_PERIOD, method=method, tolerance=tolerance)
    require_period(answer, trip)
    zero = Fraction(0)
    require_claims(answer, elliptic("PE", nu=Fraction(nu), a1=-NU_1, b1=zero, c1=zero))


@each_once(method=METHODS, b1=["1e-3", "1e-6", "1e-9", "1e-12"])
def test_s10_a_reflection_next_to_the_pole_is_not_a_passage(method, b1):
    # Turning within 1e-12 of g3 = 0 takes 1e-6 of the time that doubles resolve to 1e-16.
    answer = three_terms(-1, b1, 0, 1, {"periods": "3/2", "samples": 17}, method=method, tolerance="1e-8")
    require_claims(answer, elliptic("WE", nu=NU_1, a1=-NU_1, b1=Fraction(b1), c1=Fraction(0)))
    assert answer.columns["g3"].min() > 0
    assert answer.columns["p"].min() < 0 < answer.columns["p"].max()
    # T is continuous to that of b1 = 0, linearly: it is G1's to 2.2 b1.
    assert abs(answer.period - 6.432310535121612580) < 4 * float(Fraction(b1))


def test_s10_a_reflection_finer_than_doubles_is_seen_by_balls_and_refused_by_the_quadrature():
    answer = three_terms(-1, "1e-150", 0, 1, ONE_PERIOD)
    require_claims(answer, elliptic("WE", nu=NU_1, a1=-NU_1, b1=Fraction("1e-150"), c1=Fraction(0)))
    refused = three_terms(-1, "1e-150", 0, 1, ONE_PERIOD, method="quadrature", tolerance="1e-2")
    assert refused.code == "accuracy_not_met"


def test_s12_an_orbit_unstable_across_its_plane_is_not_left_and_its_multiplier_is_the_growth_of_q():
    body = {"A": 2, "B": 3, "C": 1}
    planar = {
        "body": body,
        "potential": {"type": "gravity", "a": -1},
        "motion": {"type": "planar", "nu": 2},
        "time": {"periods": 40, "samples": 401},
        "method": "both",
        "outputs": ["gamma", "omega", "stability"],
    }
    outcome = solve_checked(json.dumps(planar))
    summary, columns = outcome.summary, decode_arrays(outcome.samples)
    stability, check = summary["stability"], summary["cross_check"]
    assert stability["verdict"] == "unstable"
    # The last printed digit of the trace, and what the answer claims.
    assert abs(stability["trace"] - 7.205281206786) <= 5e-13 + stability["error"]
    # The quadrature knows nothing across the plane; the witness is believed only as long as it can be.
    assert not columns["q"].any()
    assert check["agrees"]
    assert check["horizon"] <= stability["trusted_time"] < columns["t"][-1]

    period = summary["period"]["value"]
    across = 1e-8
    state = [float(columns[name][0]) for name in ("p", "q", "r", "g1", "g2", "g3")]
    state[1] = across
    beside = {
        "body": body,
        "potential": planar["potential"],
        "motion": {"type": "state", "omega": state[:3], "gamma": state[3:]},
        "time": {"times": [k * period for k in range(6)]},
        "accuracy": {"tolerance": 1e-9},
    }
    outcome = solve_checked(json.dumps(beside))
    assert isinstance(outcome, Solved), outcome
    q = decode_arrays(outcome.samples)["q"]
    # From the second period on: the shrinking partner is 50^-2 of the growing part at the first end and
    # falls by 50 each period. The errors are the claim's, relative to a q that has grown above 2e-6;
    # what is not linear is of relative order |q| < 2e-4.
    growth = q[5] / q[4]
    multiplier = stability["multipliers"][0][0]
    assert abs(growth / multiplier - 1) <= 2 * 50.0**-4 + 2 * outcome.summary["error"] / abs(q[4]) + 2e-4


def test_s13_starts_at_rest_and_at_the_equator_are_exact():
    at_rest = three_terms(-1, "1/50", "6/5", 1, ONE_PERIOD, start={"at": "rest", "g2_sign": -1})
    assert np.abs(at_rest.states[0, :3]).max() <= at_rest.error
    assert at_rest.states[0, 4] < 0
    at_equator = three_terms(-1, "1/20", 0, 1, ONE_PERIOD, start={"at": "equator", "s_sign": -1})
    assert abs(at_equator.states[0, 4]) <= at_equator.error
    assert at_equator.states[1, 4] > 0 > at_equator.states[0, 2]


@pytest.mark.parametrize("method", METHODS)
def test_s14_no_motion_is_told(method):
    assert three_terms(1, 0, 0, 1, SHORT, method=method).code == "no_motion"


def rounded(value: Fraction) -> Fraction:
    """60 decimals: the printed digits are not touched, and the number fits a document."""
    return Fraction(round(value * 10**60), 10**60)
