"""A plan tells what makes a job slow, narrow or refused; and of an easy one nothing."""

import json
from math import log, pi

import numpy as np
import pytest
from flint import ctx

from service.dynamics.reduction.windows import REDUCTION_BITS, find_windows
from service.schemas.problem.problem import read_problem
from service.verdicts.documents import terms_along
from service.verdicts.examination import examine_question
from workers.computation.compute import solve

Q = "(2*g1^2+g3^2)"
AT_EQUATOR = {"start": {"at": "equator"}}


def problem(potential, *, A=2, C=1, motion=None, **other):
    if isinstance(potential, str):
        potential = {"type": "expression", "expression": potential}
    motion = {"type": "planar", "lambda": 1, **(motion or {})}
    time = {"stop": "1/10", "samples": 3}
    return {"body": {"A": A, "B": A, "C": C}, "potential": potential, "motion": motion, "time": time, **other}


def plan_of(document):
    return json.loads(examine_question(json.dumps(document)))["verdict"]["plan"]


def codes(document):
    return [remark["code"] for remark in plan_of(document)["remarks"]]


def general(F, G):
    return {"type": "general", "F": F, "G": G}


@pytest.mark.parametrize(
    "document",
    [
        problem("-g1"),
        problem("-g1+1/20/g3^2"),
        problem(f"-g1+{Q}*exp(g2)/10"),
        problem(f"-g1+{Q}*g2^30"),
        problem({"type": "rational", "a": [-1, 0], "c": ["1/10"]}),
        problem("-g1*(4*g1^2+3*g3^2)", A=4),
        problem("-g1+1/50/g3^2+6/5*(g1^2-g2^2)", motion={"window": 0}),
    ],
    ids=lambda document: str(list(document["potential"].values())[1]),
)
def test_of_an_easy_motion_nothing_is_remarked(document):
    assert codes(document) == []


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("document", "told"),
    [
        (problem("-abs(g1)^(4/7)", A=7, C=5), ["pole_passage"]),
        (problem({"type": "homogeneous", "B": [-1]}, A="101/100"), ["pole_passage"]),
        # g3^4/g1 has no second derivatives at the pole.
        (problem({"type": "rational", "a": [-1, "1/100"]}), ["pole_passage"]),
        (problem(f"{Q}*(g2^2-1/2)*(g2^2+1e-12)", motion=AT_EQUATOR), ["near_rest"]),
        (problem(f"{Q}*(g2-sin(1/3))^3", motion=AT_EQUATOR), ["separatrix"]),
        (problem(f"-g1-{Q}/20/(1/2-g2)", motion={"window": 1, **AT_EQUATOR}), ["collision"]),
        (problem(f"-g1+{Q}/10000000/(1e-6+(g2-1/2)^2)"), ["narrow_feature"]),
        (problem(f"-g1+{Q}*(g2-1/3)*log(abs(g2-1/3))/10"), ["infinite_slope", "narrow_feature"]),
        (problem(general("-exp(-w)", "tan(g2)/10")), ["integral", "pole_passage"]),
    ],
)
def test_what_is_not_easy_is_named(document, told):
    assert codes(document) == told


def arc_of(document):
    asked = read_problem(document)
    with ctx.workprec(REDUCTION_BITS):
        return find_windows(asked.body, asked.potential, asked.motion)[0].arcs[0]


def test_the_terms_of_a_narrow_feature_grow_as_its_width_falls_and_as_the_digits_asked():
    """A pole at the distance d from the motion, in its angle, leaves terms like e^(-n d)."""

    def terms(width, part):
        return terms_along(arc_of(problem(f"-g1+{Q}/100000*({width})/(({width})^2+(g2-1/2)^2)")), part)

    wide, narrow = terms("1/20", 1e-10), terms("1/40", 1e-10)
    # Twice as near; the size of the feature beside the rest of p² is a few terms.
    assert narrow == pytest.approx(2 * wide, rel=0.15)
    # Down to one part against another: differences are log(parts)/d, d being some width/|dg2/dangle|.
    differences = [terms("1/40", part) - terms("1/40", 100 * part) for part in (1e-12, 1e-11, 1e-10)]
    assert max(differences) - min(differences) <= 0.15 * max(differences)
    assert log(100) / max(differences) < 2 * pi / 40


def test_a_slope_without_a_bound_is_told_and_both_methods_agree():
    document = problem(f"-g1+{Q}*(g2-1/3)*log(abs(g2-1/3))/10", time={"stop": 2, "samples": 5})
    assert "infinite_slope" in codes(document)
    found = [solve(read_problem({**document, "method": method})) for method in ("quadrature", "integration")]
    assert [motion.method for motion in found] == ["quadrature", "integration"]
    assert max(motion.error for motion in found) <= 1e-10
    apart = np.abs(found[0].samples - found[1].samples).max()
    assert apart <= sum(motion.error for motion in found)


def test_an_integration_has_no_remarks_of_a_quadrature():
    assert codes(problem("-abs(g1)^(4/7)", A=7, C=5, method="integration")) == []
