"""Exact numbers at the ends of what is accepted: solved, or refused with a code, never an internal error."""

import json
import random
from contextlib import suppress

import numpy as np
import pytest
from flint import arb, ctx

from service.jobs.records import Refused
from service.schemas.atlas.documents import read_atlas
from service.schemas.problem.problem import read_question
from service.schemas.reading.documents import InvalidProblemError
from service.schemas.sweep.reading import read_sweep
from service.storage.codecs.packing import decode_arrays
from service.verdicts.examination import examine_question
from service.verdicts.questions import examine_atlas_of_job
from tests.support.effort import seldom
from workers.computation.compute import solve_checked
from workers.sweeping import chunk

DOUBLE = {"A": 2, "B": "3/2", "C": 1}
PERIOD = {"periods": 1, "samples": 3}
LARGE = ["1e-299", "1e-200", "1e-160", "1e-154", "1e-20", "1e20", "1e154", "1e160", "1e200", "1e299"]


def expression(text, **parameters):
    return {"type": "expression", "expression": text, "parameters": parameters}


def outcome_of(document):
    """Return the code of a refusal, None of a solution, all of whose numbers are finite."""
    try:
        outcome = solve_checked(json.dumps(document), explains=False)
    except InvalidProblemError:
        return "invalid_problem", None
    if isinstance(outcome, Refused):
        assert outcome.error["code"]
        return outcome.error["code"], None
    json.dumps(outcome.summary, allow_nan=False)
    assert all(np.all(np.isfinite(column)) for column in decode_arrays(outcome.samples).values())
    return None, outcome


def planar(potential, **motion):
    return {
        "body": DOUBLE,
        "potential": potential,
        "motion": {"type": "planar", **motion},
        "time": PERIOD,
    }


@pytest.mark.parametrize("tier", ["draft", "standard", "high"])
@pytest.mark.parametrize("exponent", [-299, -200, -160])
def test_the_period_at_a_lambda_whose_square_is_no_double(tier, exponent):
    code, outcome = outcome_of(
        {**planar(expression("-g1"), **{"lambda": f"1e{exponent}"}), "accuracy": {"tier": tier}}
    )
    assert code is None
    # Towards λ = 0 the full period of V = −g1 tends to 4 K(1/2), A = 2 and C = 1: by the mean of 1 and √½.
    with ctx.workprec(128):
        limit = 2 * arb.pi() / arb(1).agm(arb(0.5).sqrt())
        period = outcome.summary["period"]
        assert abs(arb(period["value"]) - limit) <= period["error"] + 1e-15


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "document",
    [
        planar(expression("-g1"), **{"lambda": "1e200"}),
        *seldom(planar(expression("-g1+1/20/g3^2"), **{"lambda": "1e299"})),  # ten seconds
        planar(expression("-g1"), nu="1e-300"),
        planar(expression("a*g1+b/g3^2", a="7/5", b="-3e155"), **{"lambda": "3e8", "window": 0})
        | {"time": {"stop": "1e-154", "samples": 5}, "outputs": ["gamma", "omega", "invariants"]},
        planar(expression("1e3*(A*g1^2+C*g3^2)*(g2^2-1/2+g2^3/5)"), **{"lambda": "3e-300"})
        | {"body": {"A": "2e-160", "C": "1e-160"}, "accuracy": {"tier": "certified"}},
        planar(expression("-1e300*g1"), **{"lambda": 1}) | {"body": {"A": "2e-299", "C": "1e-299"}},
        {
            "body": DOUBLE,
            "potential": expression("-1e300*g1"),
            "motion": {"type": "state", "omega": ["1e299", 0, 1], "gamma": ["3/5", 0, "4/5"]},
            "time": {"stop": "1e-299", "samples": 2},
        },
    ],
)
def test_what_was_an_internal_error_has_an_answer(document):
    outcome_of(document)


def drawn(rng):
    """Return a problem with numbers of any size."""
    text, names = rng.choice(
        [
            ("a*g1", "a"),
            ("a*g1+b/g3^2", "ab"),
            ("a*g1+b*(g1^2-g2^2)", "ab"),
            ("a*(A*g1^2+C*g3^2)*(g2^2-1/2)", "a"),
        ]
    )
    sign = {name: rng.choice(["", "-"]) for name in names}
    document = planar(
        expression(text, **{name: sign[name] + rng.choice([*LARGE, "1", "1/3"]) for name in names}),
        **{rng.choice(["lambda", "nu"]): rng.choice([*LARGE, "1", "3"])},
    )
    if rng.random() < 0.5:
        scale = rng.choice(LARGE)[2:]
        document["body"] = {"A": f"2e{scale}", "B": f"1.5e{scale}", "C": f"1e{scale}"}
    document["accuracy"] = rng.choice([{"tier": "draft"}, {"tier": "high"}, {"relative": "1e-9"}])
    document["outputs"] = ["gamma", "omega", *rng.sample(["invariants", "orientation", "stability"], 1)]
    return document


@pytest.mark.one_in(2)
@pytest.mark.parametrize("seed", [0, 1, 2, *seldom(*range(3, 60))])
def test_numbers_of_any_size_have_an_answer_in_every_way(monkeypatch, seed):
    monkeypatch.setattr(chunk, "MOST_CHUNK_SECONDS", 3600.0)
    rng = random.Random(seed)
    document = drawn(rng)
    outcome_of(document)
    question = {name: document[name] for name in ("body", "potential", "motion")}
    with suppress(InvalidProblemError):
        read_question(question)
        examine_question(json.dumps(question))
    name = "lambda" if "lambda" in document["motion"] else "nu"
    axis = {"pointer": f"/motion/{name}", "values": rng.sample(LARGE, 2)}
    sweep = {"base": document, "axes": [axis], "keep": ["period", "energy.error"]}
    with suppress(InvalidProblemError):
        read_sweep(sweep)
        found = chunk.compute_chunk(json.dumps({"sweep": sweep, "first": 0, "count": 2}))
        assert found.count == 2
    low, high = sorted(rng.sample(LARGE, 2), key=float)
    asked = {"body": document["body"], "potential": document["potential"], "lambda": [low, high]}
    with suppress(InvalidProblemError):
        read_atlas(asked)
        assert json.loads(examine_atlas_of_job(json.dumps(asked)))
