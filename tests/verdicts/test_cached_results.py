"""A kept verdict, and kept windows, are to the last bit what would be found."""

import json
from fractions import Fraction

import pytest
from flint import arb, ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction import windows as found_windows
from service.dynamics.reduction.window import starting_point
from service.dynamics.reduction.windows import find_windows, remember_windows
from service.dynamics.verdict.verdict import NumericEvidence, Verdict, decide
from service.schemas.problem.problem import check_problem, read_question
from service.storage.examinations import keys_of
from service.verdicts import cached
from service.verdicts.cached import (
    NotExactError,
    read_ball,
    read_verdict,
    read_windows,
    write_ball,
    write_verdict,
    write_windows,
)
from tests.conformance.specimens import SPECIMENS, Specimen
from tests.support.admissible import Case, sampled_cases
from tests.support.effort import one_in
from tests.support.planar import body, formula

DOUBLE = (2, 1)
GENERAL = ("17/10", 1)
Q = "(A*g1^2+C*g3^2)"
KINK = "(g1 - (2*g1^2 + g3^2)/(3/2*sqrt(2)*sqrt(g1^2 + g3^2)))"

W = "(2 + g1*g3)"

VERDICTS = {
    "counterexample": ("g1 + g3", DOUBLE),
    "counterexample in another body": ("-g1", GENERAL),
    "jump of the energy at a kink": (f"-3*g1 - abs{KINK}/10000", DOUBLE),
    "jump of the potential": ("g1 + abs(g1 - g3)/(g1 - g3)", DOUBLE),
    "undecided": (f"g1 + (1 + 3*{W} + (3 + {W})*sqrt({W}))^(1/3) - 1 - sqrt({W})", DOUBLE),
    "energies that differ by quadrant": ("abs(g1) + abs(g3)^-2/20", DOUBLE),
    "separatrix": ("-g1+(1+sqrt(5))/4*(g1^2-g2^2)", DOUBLE),
}

WINDOWS = {
    "libration and rotation": ("-g1", DOUBLE),
    "repelled by the equator": ("-g1+1/(20*g3^2)", DOUBLE),
    "separatrix": ("-g1+(1+sqrt(5))/4*(g1^2-g2^2)", DOUBLE),
    "a gap narrower than doubles": ("-g1+(1+sqrt(5))/4*(1-exp(-3000))*(g1^2-g2^2)", DOUBLE),
    "equilibrium alone": (f"{Q}*(g2+2/7)^6", GENERAL),
    "several separatrices": (f"-{Q}*(g2^2-1/3)^2*exp(g2)", DOUBLE),
    "near rests": (f"{Q}*((g2-1/3)^2+exp(-300))*(g2-2)", GENERAL),
    "collision": ("g1-1/16/g3^2-(g1^2-g2^2)", DOUBLE),
    "poles": (f"{Q}*(g2^2-1/2)", GENERAL),
    "mirrored": (f"{Q}*(g2^2-1/2)", (1, "17/10")),
    "an edge of the domain": (f"-{Q}*sqrt(g2-1/10)", DOUBLE),
    "none": ("g1", DOUBLE),
}


def exactly(windows):
    """Return windows with every ball as its midpoint and radius."""
    return [
        (
            window.index,
            window.kind,
            window.ends,
            window.g1,
            window.g2,
            [
                (
                    balls(arc.lower, arc.upper, arc.loop.Z, arc.loop.G),
                    (arc.lower_end, arc.upper_end, arc.lower is arc.upper),
                    (arc.loop.A, arc.loop.C, arc.loop.mirrored, arc.loop.g1_sign, arc.loop.factor),
                    [
                        balls(near.v, near.square, near.K, *(getattr(near.at, n) for n in near.at.__slots__))
                        for near in arc.slow
                    ],
                )
                for arc in window.arcs
            ],
        )
        for window in windows
    ]


def balls(*given):
    return [(ball.mid().man_exp(), ball.rad().man_exp()) for ball in given]


def there_and_back(rigid_body, potential, motion):
    windows = find_windows(rigid_body, potential, motion)
    text = write_windows(windows)
    assert text is not None
    kept = read_windows(text, rigid_body, potential, motion)
    assert exactly(kept) == exactly(windows)
    return windows, kept


@pytest.mark.parametrize("name", VERDICTS)
def test_a_kept_verdict_is_the_verdict(name):
    text, moments = VERDICTS[name]
    rigid_body = body(*moments)
    verdict = decide(rigid_body, formula(text, rigid_body))
    assert read_verdict(write_verdict(verdict)) == verdict


def test_the_verdicts_above_are_of_all_kinds():
    kinds = set()
    for text, moments in VERDICTS.values():
        verdict = decide(body(*moments), formula(text, body(*moments)))
        parts = {
            name for name in ("counterexample", "jump", "evidence") if getattr(verdict, name) is not None
        }
        kinds |= {verdict.verdict, verdict.proof, *parts}
    assert kinds == {
        *("admissible", "inadmissible", "undecided", "symbolic", "counterexample", "numeric"),
        *("jump", "evidence"),
    }


@pytest.mark.one_in(4)
@pytest.mark.parametrize("specimen", SPECIMENS, ids=str)
def test_what_is_kept_of_the_catalogue_is_what_is_found(specimen: Specimen):
    question = read_question(specimen.document)
    verdict = decide(question.body, question.potential)
    kept = read_verdict(write_verdict(verdict))
    assert kept == verdict
    # The order of quadrants is seen by clients.
    assert list(kept.energy_formulas or ()) == list(verdict.energy_formulas or ())
    if isinstance(question.motion, PlanarMotion):
        there_and_back(question.body, question.potential, question.motion)


@pytest.mark.parametrize("name", one_in(5, WINDOWS))
@pytest.mark.parametrize("g3_sign", [1, -1])
def test_kept_windows_are_the_windows(name, g3_sign):
    text, moments = WINDOWS[name]
    rigid_body = body(*moments)
    motion = PlanarMotion(Fraction(1), g3_sign=g3_sign)
    there_and_back(rigid_body, formula(text, rigid_body), motion)


@pytest.mark.parametrize("case", sampled_cases(12, 5), ids=lambda case: case.text[:40])
def test_kept_windows_of_random_potentials_are_the_windows(case: Case):
    problem = case.problem()
    windows, kept = there_and_back(problem.body, problem.potential, case.motion)
    for one, other in zip(windows, kept, strict=True):
        if one.kind == "periodic":
            starts = [starting_point(window, case.motion) for window in (one, other)]
            assert balls(starts[0].v) == balls(starts[1].v)
            assert starts[0].direction == starts[1].direction


def test_what_is_remembered_is_not_found_again(monkeypatch):
    rigid_body, motion = body(*DOUBLE), PlanarMotion(Fraction(11, 13))
    potential = formula("-g1", rigid_body)
    windows = find_windows(rigid_body, potential, motion)
    monkeypatch.setattr(found_windows, "_KNOWN", {})
    monkeypatch.setattr(found_windows, "_all_windows", None)
    remember_windows(rigid_body, potential, motion, windows)
    assert find_windows(rigid_body, formula("-g1", rigid_body), motion) is windows
    for number in range(found_windows.ANSWERS_CACHED):
        remember_windows(rigid_body, potential, PlanarMotion(Fraction(number + 1)), windows)
    assert len(found_windows._KNOWN) == found_windows.ANSWERS_CACHED
    with pytest.raises(TypeError):  # it would have to be found
        find_windows(rigid_body, potential, motion)


@pytest.mark.parametrize("bits", [2, 53, 160, 10240])
def test_balls_come_back_to_the_last_bit_whatever_the_precision(bits):
    with ctx.workprec(bits):
        given = [arb(2).sqrt(), -arb(2).sqrt() * arb(2) ** -3000, arb(3, 0.5), arb(0), arb(0, 1e-300)]
    assert balls(*(read_ball(json.loads(json.dumps(write_ball(ball)))) for ball in given)) == balls(*given)


def test_a_ball_without_ends_is_not_written():
    with pytest.raises(NotExactError):
        write_ball(arb(1) / arb(0))


BODY_B = {"A": 2, "B": 2, "C": 1}


def document(**changes):
    base = {
        "body": {"A": 2, "C": 1},
        "potential": {"type": "expression", "expression": "a*g1", "parameters": {"a": -1}},
        "motion": {"type": "planar", "lambda": 1},
        "time": {"periods": 1, "samples": 11},
    }
    return base | changes


def keys(**changes):
    return keys_of(check_problem(document(**changes)).canonical)


def test_equal_problems_have_equal_keys_however_they_are_written():
    other = keys(
        body={"C": "1.0", "A": "4/2", "B": "3/2"},
        potential={"type": "expression", "expression": "a * g1", "parameters": {"a": "-1.00"}},
        motion={"lambda": 1.0, "type": "planar", "g3_sign": 1},
        time={"periods": 7, "samples": 2},
        accuracy={"tier": "high"},
    )
    assert other == keys()


@pytest.mark.parametrize(
    ("changes", "same"),
    [
        ({"body": {"A": 3, "C": 1}}, set()),
        ({"potential": {"type": "gravity", "a": -2}}, set()),
        ({"motion": {"type": "planar", "lambda": 2}}, {"verdict"}),
        ({"motion": {"type": "planar", "nu": 1}}, {"verdict"}),
        ({"motion": {"type": "planar", "lambda": 1, "g3_sign": -1}}, {"verdict"}),
        ({"motion": {"type": "planar", "lambda": 1, "window": 0}}, {"verdict", "windows"}),
        ({"motion": {"type": "planar", "lambda": 1, "start": {"at": "rest"}}}, {"verdict", "windows"}),
        ({"method": "quadrature"}, {"verdict", "windows", "answer"}),
        ({"accept": "undecided"}, {"verdict", "windows"}),
        ({"time": {"stop": 1, "samples": 2}}, {"verdict", "windows"}),
    ],
)
def test_a_key_changes_with_what_its_entry_depends_on_alone(changes, same):
    one, other = keys(), keys(**changes)
    assert {name for name in one.__slots__ if getattr(one, name) == getattr(other, name)} == same


def test_an_integration_has_an_answer_of_its_own():
    time = {"stop": 1, "samples": 2}
    assert keys(time=time, body=BODY_B).answer != keys(time=time, body=BODY_B, method="integration").answer


def test_a_formula_that_names_B_depends_on_it():
    potential = {"type": "expression", "expression": "B*g1"}
    one, other = (keys(body={"A": 2, "B": B, "C": 1}, potential=potential) for B in (1, "3/2"))
    assert one.verdict != other.verdict
    assert one.windows != other.windows


def undecided_verdict(*given):
    return Verdict("undecided", "numeric", evidence=NumericEvidence(9, 4096, "0 ± 1", "that it holds"))


@pytest.mark.parametrize(("seconds", "is_kept"), [(1000.0, True), (-1.0, False)])
def test_a_verdict_that_time_left_open_is_not_kept(monkeypatch, seconds, is_kept):
    monkeypatch.setattr(cached, "decide", undecided_verdict)
    monkeypatch.setattr(cached, "VERDICT_PROCESSOR_SECONDS", seconds)
    found = cached.ResultCache({})
    found.verdict("a key", body(*DOUBLE), formula("g1", body(*DOUBLE)))
    assert ("a key" in found.found) is is_kept
