"""A point of a sweep is the job of its document, whatever way the chunk took."""

import json
import time

import numpy as np
import pytest

from service.dynamics.verdict.verdict import decide
from service.jobs.records import Refused
from service.schemas.problem.problem import read_problem
from service.schemas.sweep.reading import read_sweep
from service.schemas.sweep.sweep import kept_numbers
from service.storage.codecs.packing import SOLVED, decode_arrays, decode_points
from service.verdicts import cached
from service.verdicts.examination import examine_document
from tests.support.effort import one_in
from workers.computation.compute import solve_checked
from workers.sweeping import chunk, states
from workers.sweeping.chunk import compute_chunk
from workers.sweeping.plan import make_plan

DOUBLE = {"A": 2, "B": "3/2", "C": 1}
THREE_TERMS = {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/50"}}
TIME = {"stop": 20, "samples": 7}
STATE = {"type": "state", "omega": [0, "1/10", 1], "gamma": ["3/5", 0, "4/5"]}
LOOSE, DRAFT, HIGH = {"tolerance": 1e-9}, {"tier": "draft"}, {"tier": "high"}
A, B = "/potential/parameters/a", "/potential/parameters/b"
LAMBDA, NU = "/motion/lambda", "/motion/nu"


def sweep(*axes, base=None, combine="grid", keep=("period", "energy", "error"), series=True, **fields):
    problem = {
        "body": DOUBLE,
        "potential": THREE_TERMS,
        "motion": {"type": "planar", "lambda": 1},
        "time": TIME,
        "accuracy": LOOSE,
        **fields,
    }
    listed = [{"pointer": pointer, **values} for pointer, values in axes]
    return {"base": problem, "axes": listed, "combine": combine, "keep": list(keep), "series": series}


def values(*numbers):
    return {"values": list(numbers)}


def uniform(lo, hi, count=4, seed=1):
    return {"uniform": [lo, hi, count], "seed": seed}


def expression(text, **parameters):
    return {"type": "expression", "expression": text, "parameters": parameters}


IN_BLOCKS = {
    "parameters and lambda": sweep(
        (A, uniform(-2, -0.5)), (B, uniform(0.01, 0.04)), (LAMBDA, uniform(0.7, 1.4)), combine="zip"
    ),
    "draft": sweep((A, uniform(-2, -0.5)), (LAMBDA, values("1/3", 0.9)), accuracy=DRAFT),
    "nothing in the potential": sweep((LAMBDA, {"logspace": [0.3, 2, 5]})),
    "every number that can be kept": sweep(
        (A, uniform(-2, -1)),
        keep=("period", "period.error", "energy", "energy.error", "error", "cross_check.disagreement"),
    ),
    "both signs of nu, and none": sweep(
        (NU, {"linspace": [-1, 1, 5]}), (A, values(-1, 1)), motion={"type": "planar", "nu": -1}
    ),
    "lambda that is none": sweep((LAMBDA, values(1, 0, -1))),
    "no motion": sweep((A, values(1, 2))),
    "from a motion to none": sweep((B, {"linspace": ["1/100", 1, 5]}), accuracy=DRAFT),
    "constants worked out from parameters": sweep(
        (A, uniform(-2, -1)),
        (B, values("1/70", "0.02")),
        potential=expression("a*g1/3 - 2*(b + 1/7)/(-g3^2)/20 + sqrt(2)*a*g1", a=-1, b=1),
    ),
    "parameters that shorten the formula": sweep(
        (A, values(-1, 1, 0, "-1/50")), (B, values("1/50", 1, 0)), potential=THREE_TERMS
    ),
    "one window or several": sweep(
        (A, values(0, "-1/2", -1)), potential=expression("g1 - 1/(20*g3^2) + a*(g1^2-g2^2)", a=-1)
    ),
    "gravity": sweep(("/potential/a", uniform(-2, 2)), potential={"type": "gravity", "a": 1}),
    "rational": sweep(
        ("/potential/a/0", uniform(-2, -1)),
        ("/potential/c/1", values(0, "1/5", -1)),
        potential={"type": "rational", "a": [-1], "b": ["1/50"], "c": [0, "1/5"]},
    ),
    "poles passed by convention": sweep(
        ("/potential/a/1", values(0, "1/50")),
        (LAMBDA, values(1, "3/2")),
        potential={"type": "rational", "a": [-1, "1/50"]},
    ),
    "homogeneous": sweep(
        ("/potential/B/0", uniform(-2, -1)),
        (LAMBDA, uniform("1/2", 1, 2)),
        body={"A": "17/10", "C": 1},
        potential={"type": "homogeneous", "A": [0, "1/10"], "B": [-1], "C": ["1/20"]},
    ),
    "A < C": sweep(
        (LAMBDA, uniform("1/2", 2)),
        body={"A": 1, "C": 2},
        potential=expression("-g3 + b/g1^2", b="1/50"),
    ),
    "in periods": sweep((A, uniform(-2, -1)), time={"periods": "5/2", "samples": 6}),
    "in periods, numbers alone": sweep(
        (A, uniform(-2, -1)), time={"periods": "5/2", "samples": 6}, series=False
    ),
    "listed times": sweep((A, uniform(-2, -1)), time={"times": [3, -1, "1/3"]}),
    "numbers alone": sweep((A, uniform(-2, -1)), series=False),
    "gamma alone": sweep((A, uniform(-2, -1)), outputs=["gamma"]),
    "periods alone": sweep((A, uniform(-2, -1)), outputs=["period"], series=False),
    "an energy of 0": sweep((LAMBDA, values(1, 2)), potential=expression("(2*g1^2+g3^2)*(g2^2-1/2)")),
    "from rest": sweep(
        (A, uniform(-2, -1)),
        motion={"type": "planar", "lambda": 1, "start": {"at": "rest", "g2_sign": -1}, "g3_sign": -1},
    ),
    "windows next to a pole that doubles do not see": sweep(
        (B, values("-1e-13", "-1e-20", "1e-20", "-1e-60")),
        potential=expression("g1 + b/g3^2 - 2*(g1^2-g2^2)", b=0),
    ),
    "too fine for doubles": sweep(
        (A, values(-1)), (LAMBDA, uniform(1, 2)), accuracy={"tolerance": "1.1e-10"}
    ),
}
IN_BLOCKS |= {
    "standard": sweep((A, uniform(-2, -1)), (LAMBDA, uniform("1/2", 2, 2)), accuracy={"tier": "standard"}),
    "1e-10, in periods": sweep(
        (A, uniform(-2, -1)), accuracy={"tolerance": 1e-10}, time={"periods": 3, "samples": 5}
    ),
    "starts": sweep(
        ("/motion/start/g1", values("1/2", "3/10", 1, -1, 0)),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
    ),
    "from a given start, in periods": sweep(
        (LAMBDA, uniform("1/2", 1)),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/3", "g2_sign": -1, "s_sign": -1}},
        time={"periods": 3, "samples": 5},
    ),
    "starts at ends and next to them": sweep(
        ("/motion/start/g1", values("1/2", "0.1", "0.100000000000001", "0.1000001", "0.61803398874989")),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
        potential=expression("-g1 + b/g3^2", b="1/20"),
    ),
    "starts for A < C": sweep(
        ("/motion/start/g1", uniform("2/5", "3/5", 3)),
        (LAMBDA, uniform("3/4", "5/4", 2)),
        body={"A": 1, "C": 2},
        potential=expression("-g3 + b/g1^2", b="1/50"),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
    ),
    "the moment that planar motions do not depend on": sweep(
        ("/body/B", values("3/2", 1, 3, 4, "1/2", 0, -1))
    ),
    "that moment of a body that cannot be": sweep(
        ("/body/B", values("3/2", 4, 0, -1)), body={"A": 2, "B": 1, "C": 1, "allow_unphysical": True}
    ),
    "drifts": sweep(
        (A, uniform(-2, -1, 2)),
        (LAMBDA, uniform("1/2", 1, 2)),
        keep=("invariants.energy.drift", "invariants.geometric.drift", "invariants.areas.drift"),
        outputs=["gamma", "invariants"],
    ),
    "the drift from an energy that cancels": sweep(
        ("/potential/parameters/c", values("-23/50", "-1/2", "1/2")),
        keep=("invariants.energy.drift",),
        outputs=["gamma", "invariants"],
        series=False,
        potential=expression("-g1 + 1/(50*g3^2) + c", c=1),
    ),
    "the drift of a potential that cancels": sweep(
        ("/potential/parameters/c", values(1, f"{10**33}", 2)),
        keep=("invariants.energy.drift",),
        outputs=["gamma", "invariants"],
        series=False,
        potential=expression("(c - g1) - c + 1/(50*g3^2)", c=1),
    ),
    "the drift of the areas alone, in periods": sweep(
        (LAMBDA, uniform("1/2", 1, 2)),
        keep=("invariants.areas.drift",),
        series=False,
        outputs=["invariants"],
        time={"periods": 2, "samples": 9},
    ),
    "not linear in its parameters": sweep(
        (A, uniform(-2, -1)),
        (B, values("1/7", 0, -1)),
        potential=expression("a^3*(b^2 + 2)*g1 + b^2/g3^2 - 3*(a - b)*a*g1", a=-1, b="1/7"),
    ),
    "powers that have no value for a parameter": sweep(
        (B, values("1/7", 0, "1/3")), potential=expression("-(1/b^2)*g1 + b/g3^2/50", b="1/7")
    ),
    "coefficients of a family, of both signs": sweep(
        ("/potential/a/0", uniform(-2, -1, 3)),
        ("/potential/c/0", values("-1/5", "1/7", 0, 1)),
        potential={"type": "rational", "a": [-1], "b": ["1/50"], "c": ["1/5"]},
    ),
}
IN_BLOCKS |= {
    "high": sweep(
        (A, uniform(-1, "-1/2", 3)),
        (B, values("1/20", "0.04")),
        (LAMBDA, uniform("1/2", 2, 2)),
        keep=("period", "period.error", "energy", "energy.error", "error"),
        time={"stop": 5, "samples": 7},
        accuracy=HIGH,
    ),
    "1e-12, in periods": sweep(
        (LAMBDA, uniform("1/2", 2)), accuracy={"tolerance": 1e-12}, time={"periods": "7/3", "samples": 5}
    ),
    "high, numbers alone, in periods": sweep(
        (LAMBDA, uniform("1/2", 2)), accuracy=HIGH, series=False, time={"periods": "7/3", "samples": 5}
    ),
    "high, periods alone": sweep((A, uniform(-2, -1)), accuracy=HIGH, outputs=["period"], series=False),
    "high, drifts": sweep(
        (LAMBDA, uniform("1/2", 1, 2)),
        keep=("energy", "invariants.energy.drift", "invariants.areas.drift"),
        outputs=["gamma", "invariants"],
        accuracy=HIGH,
    ),
    "high, of both signs of nu, and none": sweep(
        (NU, {"linspace": [-1, 1, 5]}), motion={"type": "planar", "nu": -1}, accuracy=HIGH
    ),
    "high, starts": sweep(
        ("/motion/start/g1", values("1/2", "3/10", "0.55", 1, -1, 0)),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
        potential=expression("-g1 + b/g3^2", b="1/20"),
        accuracy=HIGH,
    ),
    "high, for A < C": sweep(
        (LAMBDA, uniform("3/4", "5/4", 3)),
        ("/motion/start/g1", values("1/2", "3/5")),
        body={"A": 1, "C": 2},
        potential=expression("-g3 + b/g1^2", b="1/50"),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
        accuracy=HIGH,
    ),
    "high, one window or several": sweep(
        (A, values(0, "-1/2", -1)),
        potential=expression("g1 - 1/(20*g3^2) + a*(g1^2-g2^2)", a=-1),
        accuracy=HIGH,
    ),
    "high, parameters that shorten the formula": sweep(
        (A, values(-1, 1, 0, "-1/50")), (B, values("1/50", 1, 0)), potential=THREE_TERMS, accuracy=HIGH
    ),
    "high, of moments that are not double": sweep(
        (LAMBDA, uniform("3/4", 1, 2)),
        (A, values("1/5", "1/7")),
        body={"A": "17/10", "C": 1},
        potential=expression("(A*g1^2+C*g3^2)*(g2^2-1/2+a*g2^3)", a="1/5"),
        keep=("period", "period.error", "error"),
        accuracy=HIGH,
    ),
    "high, the same in periods, without a series": sweep(
        (LAMBDA, uniform("3/4", 1, 2)),
        body={"A": "17/10", "C": 1},
        potential=expression("(A*g1^2+C*g3^2)*(g2^2-1/2+g2^3/5)"),
        time={"periods": "7/3", "samples": 5},
        series=False,
        accuracy=HIGH,
    ),
    "high, late": sweep(
        (LAMBDA, uniform("1/2", 2, 3)), accuracy=HIGH, time={"start": 1e6, "stop": 1000010, "samples": 5}
    ),
}
IN_BLOCKS |= {
    "further invariants": sweep(
        (A, uniform(-2, -1, 2)),
        (LAMBDA, uniform("1/2", 1, 2)),
        keep=("invariants.energy.drift", "invariants.kovalevskaya", "invariants.kovalevskaya.drift"),
        outputs=["gamma", "omega", "invariants"],
        body={"A": 2, "B": 2, "C": 1},
        potential=expression("a*g1", a=-1),
    ),
    "a further invariant along areas of zero, and another that is none": sweep(
        (NU, values("-1/2", "1/2", 1)),
        keep=("invariants.goriachev", "invariants.goriachev.drift", "invariants.kovalevskaya"),
        outputs=["gamma", "invariants"],
        series=False,
        body={"A": 2, "B": 2, "C": 1},
        motion={"type": "planar", "nu": 1},
        potential=expression("-abs(g1) + b/g3^2", b="1/20"),
    ),
    "a further invariant that there is not": sweep(
        (LAMBDA, uniform("1/2", 1, 3)), keep=("invariants.kovalevskaya",), outputs=["gamma", "invariants"]
    ),
}
STABILITY = (
    "stability.trace",
    "stability.trace.error",
    "stability.exponent",
    "stability.exponent.error",
    "stability.trusted_time",
)
PRECESSION = ("precession.psi1", "precession.psi1.error", "precession.psi3", "precession.psi3.error")
STEADY = {"type": "gravity", "a": -1}
IN_BLOCKS |= {
    "stability": sweep(
        (A, uniform(-2, -1, 2)),
        (LAMBDA, uniform("1/2", 1, 3)),
        keep=("period", "energy", *STABILITY),
        outputs=["gamma", "stability"],
    ),
    "stability through the poles, stable and not, along the moment that it depends on": sweep(
        ("/body/B", values("3/2", 2, "14/5", 3, 5)),
        keep=STABILITY,
        outputs=["stability"],
        potential=STEADY,
        motion={"type": "planar", "nu": 2},
        series=False,
    ),
    "a trace that is 2, left to single jobs": sweep(
        ("/body/B", values("3/2", 1)),
        keep=STABILITY,
        outputs=["stability"],
        potential=STEADY,
        series=False,
    ),
    "precession": sweep(
        (NU, values("1/3", 1, 2)),
        keep=("error", *PRECESSION),
        outputs=["omega", "orientation"],
        potential=STEADY,
        motion={"type": "planar", "nu": 1},
        series=False,
    ),
    "precession and stability, A < C, draft": sweep(
        (LAMBDA, uniform("1/2", 3, 3)),
        keep=(*PRECESSION, *STABILITY),
        outputs=["gamma", "orientation", "stability"],
        body={"A": 1, "B": "3/2", "C": 2},
        potential=expression("-g3"),
        accuracy=DRAFT,
        series=False,
        motion={"type": "planar", "lambda": 1, "start": {"at": "equator", "s_sign": -1}},
    ),
    "precession and stability of librations from a point": sweep(
        ("/motion/start/g1", values("1/5", "3/10")),
        keep=(*PRECESSION, *STABILITY),
        outputs=["orientation", "stability"],
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/5"}},
        series=False,
    ),
}
IN_BLOCKS |= {
    "the end of the times": sweep(("/time/stop", values(1, 10, -1, "1/3"))),
    "their start, numbers alone": sweep(
        ("/time/start", uniform(-5, 5)),
        (LAMBDA, uniform("1/2", 1)),
        combine="zip",
        time={"start": 0, "stop": 6, "samples": 3},
        series=False,
    ),
    "numbers of periods": sweep(
        ("/time/periods", values(1, "5/3", 0)), (A, values(-1, 1)), time={"periods": 1, "samples": 4}
    ),
    "numbers of periods, numbers alone": sweep(
        ("/time/periods", uniform(1, 9)), time={"periods": 1, "samples": 4}, series=False
    ),
}
POWERS = {"type": "homogeneous", "A": [0, "1/10"], "B": [-1], "C": ["1/20"]}
SMALL = {"stop": 5, "samples": 4}
MOMENT_A, MOMENT_B, MOMENT_C, K = "/body/A", "/body/B", "/body/C", "/potential/parameters/k"
PARTLY_IN_BLOCKS = {
    # Most points miss the tier in blocks, and keep it by other solvers of their jobs.
    "quick, by another solver of the same tier": sweep(
        (LAMBDA, uniform("1/2", 2, 6)),
        body={"A": "2.348708749685777", "B": 2, "C": 1},
        potential={"type": "homogeneous", "B": ["-1e9"], "C": ["1e7"]},
        time={"stop": "1/5000", "samples": 4},
        accuracy=DRAFT,
    ),
}
IN_MOVING = {
    "a moment": sweep((MOMENT_A, values("17/10", 1, "9/5", -1, "19/10")), potential=POWERS, time=SMALL),
    "a moment that was drawn": sweep((MOMENT_A, uniform("3/2", 3)), potential=POWERS, time=SMALL),
    "the other moment": sweep(
        (MOMENT_C, values("1.234567890123456", 2, "0.7", 4)), potential=POWERS, time=SMALL
    ),
    "the other moment, larger": sweep(
        (MOMENT_C, values("2.567890123456789", 2, "31/10", 4)),
        potential={"type": "homogeneous", "A": [0, "1/10"], "B": ["1/20"], "C": [-1]},
        time=SMALL,
    ),
    "all that can vary": sweep(
        (MOMENT_A, uniform("3/2", 3, 6)),
        (MOMENT_B, uniform("1/2", "5/2", 6, 2)),
        (MOMENT_C, uniform("3/4", "5/4", 6, 3)),
        ("/potential/B/0", uniform(-2, 1, 6, 4)),
        (LAMBDA, uniform("1/2", 2, 6, 5)),
        ("/time/stop", uniform(1, 9, 6, 6)),
        combine="zip",
        potential=POWERS,
        time=SMALL,
        keep=("period", "period.error", "energy", "energy.error", "error"),
    ),
    "many terms": sweep(
        (MOMENT_A, uniform("7/4", "9/4", 3)),
        potential={
            "type": "homogeneous",
            "A": ["1/20", 0, "-1/9"],
            "B": [-1, "1/9"],
            "C": ["1/20", "-1/999"],
        },
        time=SMALL,
    ),
    "moments that name no term, and those with one more": sweep(
        (MOMENT_A, values("5/2", 3, "3/2")),
        potential={"type": "homogeneous", "B": [-1, 0, "1/50"], "C": ["1/20"]},
        time=SMALL,
    ),
    "moments in a formula": sweep(
        (MOMENT_A, uniform("3/2", "5/2", 3)),
        (MOMENT_B, values("3/2", "1/9")),
        potential=expression(
            "-b*abs(g1)^(2*(A-C)/A) + c/abs(g3)^(2*(A-C)/C) + (A*g1^2+C*g3^2)*g2/B", b=1, c="1/20"
        ),
        time=SMALL,
    ),
    "a formula for one moment only": sweep((MOMENT_A, values(2, "3/2", "2.0000001")), time=SMALL),
    "gravity": sweep((MOMENT_A, values(2, "3/2")), potential={"type": "gravity", "a": -1}, time=SMALL),
    "double moments": sweep(
        (MOMENT_A, values(2, 3, "5/2")),
        (MOMENT_C, values(1, "3/2", 1)),
        (NU, values(1, 2, 3)),
        combine="zip",
        motion={"type": "planar", "nu": 1},
        potential={"type": "rational", "a": [-1], "b": ["1/20"]},
        time=SMALL,
    ),
    "through the poles": sweep(
        (MOMENT_A, values(2, 3, "5/2")),
        (MOMENT_C, values(1, "3/2", "5/4")),
        combine="zip",
        potential=expression("-g1 + (2*g1^2 + g3^2)*g2/20"),
        time=SMALL,
    ),
    "a start": sweep(
        (MOMENT_A, uniform("3/2", "5/2", 2)),
        ("/motion/start/g1", values("1/2", 1, -1)),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
        potential=POWERS,
        time=SMALL,
    ),
    "no motion for any moment": sweep(
        (MOMENT_A, uniform("3/2", "5/2", 2)),
        (MOMENT_C, values(1, 3)),
        potential={"type": "homogeneous", "B": [1], "C": ["1/9"]},
    ),
    "no motion for some moments": sweep(
        (MOMENT_A, values("3/2", "7/4", 2, "5/2")),
        potential={"type": "homogeneous", "B": [-1], "C": ["1/3"]},
        time=SMALL,
    ),
    "an exponent that is admissible once": sweep(
        (K, values(2, 1, 3, "2.000000000000001")),
        (LAMBDA, uniform("1/2", 1, 2)),
        potential=expression("a*g1 + b/g3^k", a=-1, b="1/50", k=2),
        time=SMALL,
    ),
    "exponents": sweep(
        (K, values(0, 1, 2, 5)),
        potential=expression("-g1 + b/g3^2 + (A*g1^2 + C*g3^2)*g2^k/10", k=2, b="1/50"),
        time=SMALL,
    ),
    "an exponent and a moment": sweep(
        (K, values(1, 2, 3)),
        (MOMENT_A, uniform("3/2", "5/2", 3)),
        combine="zip",
        potential=expression(
            "-abs(g1)^(2*(A-C)/A) + 1/20/abs(g3)^(2*(A-C)/C) + (A*g1^2 + C*g3^2)*g2^k/10", k=2
        ),
        time=SMALL,
    ),
    "a parameter under a function": sweep(
        (K, uniform(-1, 1, 3)), potential=expression("b/g3^2 - exp(k)*g1", k=0, b="1/50"), time=SMALL
    ),
    "moments, relative to the size of a quick motion": sweep(
        (MOMENT_A, uniform("3/2", "5/2", 3)),
        potential={"type": "homogeneous", "B": ["-1e9"], "C": ["1e7"]},
        time={"stop": "1/5000", "samples": 4},
        accuracy={"relative": "1e-9"},
    ),
    "moments of a quick motion": sweep(
        (MOMENT_A, uniform("3/2", "5/2", 3)),
        potential={"type": "homogeneous", "B": ["-1e22"], "C": ["1e20"]},
        time={"stop": "1/10000000000", "samples": 4},
        accuracy=DRAFT,
    ),
    "a parameter under a function, drawn with lambda": sweep(
        (K, uniform("1/2", 1, 3)),
        (LAMBDA, uniform("1/2", 1, 3, 2)),
        combine="zip",
        potential=expression("b/g3^2 - g1 - (2*g1^2 + g3^2)*(cos(k*g2) + exp(-k*g2^2))/20", k=1, b="1/50"),
        time=SMALL,
    ),
}
IN_SLICES = {
    "windows": sweep(
        ("/motion/window", values(0, 1, 0)),
        (LAMBDA, values(1, "9/10")),
        motion={"type": "planar", "lambda": 1, "window": 0},
    ),
    "signs": sweep(
        ("/motion/g3_sign", values(1, -1, -1)),
        ("/motion/start/s_sign", values(-1, 1, -1)),
        (LAMBDA, uniform("1/2", 1, 3)),
        combine="zip",
        motion={"type": "planar", "lambda": 1, "g3_sign": 1, "start": {"at": "equator", "s_sign": 1}},
    ),
    "moments, of what is no sum of powers": sweep(
        (MOMENT_A, values("17/10", "9/5", "9/10", 1)),
        (LAMBDA, uniform("1/2", 1, 2)),
        potential=expression("-abs(g1)^(2*(A-C)/A) + 1/20/abs(g3)^(2*(A-C)/C) + (A*g1^2 + C*g3^2)/(20 + g2)"),
        time=SMALL,
    ),
    "a parameter under a function": sweep(
        (A, uniform(1, 2, 2)),
        (LAMBDA, uniform("1/2", 1, 3)),
        potential=expression("-exp(a)*g1/4 + b/g3^2", a=1, b="1/50"),
        time={"stop": 5, "samples": 3},
    ),
    "no motion for some": sweep(
        (A, values(0, 3)),
        (LAMBDA, uniform(1, 2, 3)),
        potential=expression("cos(a)*g1 + b/g3^2", a=0, b="1/50"),
    ),
    "inadmissible for one value": sweep(
        (B, values(0, 1, -1)), (LAMBDA, uniform(1, 2, 3)), potential=expression("-g1 + b*(b-1)*g2*g1^3", b=0)
    ),
    "an exponent, high": sweep(
        ("/potential/parameters/k", values(2, 0)),
        (LAMBDA, uniform("1/2", 1, 3)),
        potential=expression("a*g1 + b/g3^k", a=-1, b="1/50", k=2),
        accuracy=HIGH,
        time={"stop": 1, "samples": 3},
    ),
}
ONE_BY_ONE = {
    "a simpler formula on every curve": sweep(
        (LAMBDA, values("2/3", 1)), potential=expression("1e6*(g1^2+g2^2+g3^2-1)-g1+1/20/g3^2")
    ),
    "a simpler formula at some of the points": sweep(
        (A, values(0, 1, 10**6)), potential=expression("a*(g1^2+g2^2+g3^2-1)-g1+1/20/g3^2", a=1)
    ),
    "gravity that is not admissible but for c = 0": sweep(
        ("/potential/c", values(0, "1/2")), potential={"type": "gravity", "a": -1, "c": 0}
    ),
    "high, of what is no sum of powers": sweep(
        (A, uniform(1, 2, 2)),
        potential=expression("-a*g1*exp(2*g1^2+g3^2-2*g1^2-g3^2)+sqrt(2)*g1", a=1),
        accuracy=HIGH,
    ),
    "certified": sweep((A, uniform(-2, -1, 2)), keep=("period",), accuracy={"tier": "certified"}),
    "admissible for one value": sweep(
        (B, values(0, 1, -1)), potential=expression("-g1 + b*(b-1)*g2*g1^3", b=0)
    ),
    "further invariants along the moment that they depend on": sweep(
        ("/body/B", values(2, "3/2")),
        keep=("invariants.kovalevskaya",),
        outputs=["gamma", "omega", "invariants"],
        body={"A": 2, "B": 2, "C": 1},
        potential=expression("a*g1", a=-1),
    ),
    "high, stability": sweep(
        (LAMBDA, uniform("1/2", 1, 2)), keep=STABILITY, outputs=["gamma", "stability"], accuracy=HIGH
    ),
    "axes that are all but vertical": sweep(
        (LAMBDA, values("1/10000", 1)),
        keep=PRECESSION,
        outputs=["orientation"],
        potential=STEADY,
        series=False,
    ),
    "orientation": sweep(
        (A, uniform(-2, -1, 2)), keep=("precession.psi1",), outputs=["gamma", "omega", "orientation"]
    ),
    "an integral": sweep(
        (LAMBDA, uniform(1, 2, 2)), potential={"type": "general", "F": "w^2", "G": "0"}, series=False
    ),
    "any state, with invariants": sweep(
        ("/motion/omega/0", values(0, "2/5")),
        motion=STATE,
        keep=("energy", "invariants.energy.drift"),
        outputs=["gamma", "omega", "invariants"],
        time={"stop": 1, "samples": 3},
    ),
    "zeros of no power": sweep(
        ("/potential/parameters/w", values("1/2", 2)),
        keep=("period",),
        series=False,
        outputs=["period"],
        potential=expression("-(2*g1^2+g3^2)*exp(-w/(g2-1/3)^2)*(g2+1/2)", w=1),
        motion={"type": "planar", "lambda": 1, "window": 1},
        time={"stop": 1, "samples": 3},
    ),
    "both methods": sweep(
        (A, values(-1)), method="both", keep=("cross_check.disagreement",), time={"stop": 1, "samples": 3}
    ),
}


OF_STATES = {
    "any state": sweep(
        ("/motion/omega/0", uniform("1/10", "9/10", 3)),
        ("/motion/omega/1", values(0, "1/3")),
        motion=STATE,
        keep=("period", "energy", "energy.error", "error"),
    ),
    "gamma that is not of length 1": sweep(
        ("/motion/gamma/0", values("3/5", "0.6000000000001", "7/10")), motion=STATE
    ),
    "moments, and what is no body": sweep(
        ("/body/A", values(2, "7/3", "1/4")), ("/body/B", values("3/2", 0)), motion=STATE
    ),
    "moments in the formula": sweep(
        ("/body/B", values("3/2", "5/3")),
        ("/motion/omega/2", values(1, "1/2")),
        motion=STATE,
        potential=expression("-B*g1 + C*g2^2/A"),
    ),
    "parameters of the potential, and none": sweep(
        (A, uniform(-2, -1, 2)), (B, values("1/50", 0)), ("/motion/omega/0", values(0.1, 0.2)), motion=STATE
    ),
    "numbers of the potential that are folded, and equal ones": sweep(
        (A, values("-1/3", "1/20", 1, 2)),
        (B, values("1/20", "1/7")),
        motion=STATE,
        potential=expression("a^2*g1/3 + b/(7*g3^2) + exp(a)*g2*b - (a + b)*g1*g2", a=1, b=1),
    ),
    "a number that is an exponent": sweep(
        (A, values("5/2", 2, -1)), motion=STATE, potential=expression("-g1 + (2 + g3)^a/20", a=1)
    ),
    "functions, both ways in time": sweep(
        ("/motion/omega/0", values("-1/2", "1/7")),
        motion=STATE,
        potential=expression("exp(g2)*sin(g1) + log(2+g3)*g2^(1/3+2/3) + tan(g1/4) + sqrt(2+g2) + 2^g3"),
        time={"start": -2, "stop": 3, "samples": 5},
    ),
    "a pole that is hit": sweep(
        ("/motion/omega/0", values(0, 3)),
        motion=STATE,
        potential=expression("-g1 - 1/g3^2"),
        time={"stop": 3, "samples": 3},
    ),
    "too fine for doubles, states": sweep(
        ("/motion/omega/0", values(0, "1/2")), motion=STATE, accuracy={"tolerance": 1e-15}
    ),
    "draft, state": sweep(("/motion/omega/0", values(0.3)), motion=STATE, accuracy=DRAFT),
    "a kink, state": sweep(
        ("/motion/omega/0", values(0, "1/2")),
        motion=STATE,
        potential=expression("abs(g2) - g1"),
        time={"stop": 1, "samples": 3},
    ),
}
"""Motions from any state, which kernels solve without documents."""


@pytest.fixture(autouse=True)
def plans_are_made_anew():
    chunk._solver_of.cache_clear()


@pytest.fixture
def no_hurry(monkeypatch):
    """The first compiled point of an installation is compiled."""
    monkeypatch.setattr(chunk, "MOST_CHUNK_SECONDS", 600.0)


def computed(document, first=0, count=None):
    points = read_sweep(document).points if count is None else count
    return compute_chunk(json.dumps({"sweep": document, "first": first, "count": points}))


def alone(swept, index):
    """The outcome, numbers and series of a point's job, or of what is refused before it."""
    problem = swept.document(index)
    answer = examine_document(problem, read=read_problem).answer
    if "error" in answer:
        return answer["error"]["code"], [np.nan] * len(swept.keep), {}
    outcome = solve_checked(json.dumps(problem))
    if isinstance(outcome, Refused):
        return outcome.error["code"], [np.nan] * len(swept.keep), {}
    return SOLVED, kept_numbers(outcome.summary, swept.keep), decode_arrays(outcome.samples)


@pytest.mark.usefixtures("no_hurry")
@pytest.mark.parametrize(
    "name",
    [*one_in(6, IN_BLOCKS), *PARTLY_IN_BLOCKS, *one_in(5, [*IN_MOVING, *IN_SLICES, *OF_STATES, *ONE_BY_ONE])],
)
def test_every_bit_of_a_point_is_that_of_its_job(name):
    document = {**IN_BLOCKS, **PARTLY_IN_BLOCKS, **IN_MOVING, **IN_SLICES, **OF_STATES, **ONE_BY_ONE}[name]
    swept = read_sweep(document)
    outcome = computed(document)
    assert outcome.count == swept.points
    points = decode_points(outcome.data)
    for index in range(swept.points):
        expected, numbers, series = alone(swept, index)
        assert points.outcomes[index] == expected, swept.document(index)
        found = [points.numbers[kept][index] for kept in swept.keep]
        assert np.array_equal(found, numbers, equal_nan=True), swept.document(index)
        for column in swept.series_columns:
            row = np.full(swept.samples, np.nan)
            # A motion that ends has only the samples before.
            row[: len(series.get(column, ()))] = series.get(column, ())
            assert np.array_equal(points.series[column][index], row, equal_nan=True), (index, column)


@pytest.mark.usefixtures("no_hurry")
@pytest.mark.parametrize("name", one_in(6, IN_BLOCKS))
def test_a_sweep_that_says_so_goes_in_blocks(name, monkeypatch):
    document = IN_BLOCKS[name]
    assert make_plan(read_sweep(document)).rows is not None
    singly = []
    original = chunk.solve_point
    monkeypatch.setattr(
        chunk, "solve_point", lambda *point, **judged: singly.append(point) or original(*point, **judged)
    )
    points = decode_points(computed(document).data)
    # Each refusal but that of no motion, two points for comparison, and those that doubles leave in doubt.
    in_doubt = {"poles passed by convention", "one window or several", "high, one window or several"}
    in_doubt |= {"a trace that is 2, left to single jobs"}
    allowed = sum(outcome not in (SOLVED, "no_motion") for outcome in points.outcomes) + 2
    assert any(outcome in (SOLVED, "no_motion") for outcome in points.outcomes)
    assert name in in_doubt or len(singly) <= allowed or name in SHORTER


SHORTER = {
    "parameters that shorten the formula",
    "high, parameters that shorten the formula",
    "too fine for doubles",
    "windows next to a pole that doubles do not see",
    "starts at ends and next to them",
    "not linear in its parameters",
    "coefficients of a family, of both signs",
}
"""Sweeps of which some points, though solved, leave the common way."""


@pytest.mark.parametrize(
    "name",
    [
        "certified",
        "orientation",
        "any state, with invariants",
        "a simpler formula on every curve",
    ],
)
def test_other_sweeps_go_point_by_point(name):
    plan = make_plan(read_sweep(ONE_BY_ONE[name]))
    assert plan.rows is None
    assert chunk.ChunkSolver(plan)._blocks is None


@pytest.mark.one_in(4)
@pytest.mark.usefixtures("no_hurry")
@pytest.mark.parametrize("name", IN_MOVING)
def test_points_of_other_bodies_and_exponents_go_in_blocks(name, monkeypatch):
    document = IN_MOVING[name]
    plan = make_plan(read_sweep(document))
    assert plan.rows is None
    solver = chunk.ChunkSolver(plan)
    assert solver._blocks is not None
    assert solver._slices is None
    singly = []
    original = chunk.solve_point
    monkeypatch.setattr(
        chunk,
        "solve_point",
        lambda sweep, index, **judged: singly.append(index) or original(sweep, index, **judged),
    )
    count = plan.sweep.points
    outcomes = solver.solve(0, count, time.perf_counter() + 600.0).outcomes
    # The first of each outcome is compared with its single job.
    assert len(singly) <= len(set(outcomes)) + LEFT.get(name, 0)


LEFT = {
    # B_2 has no value for A = 3C, nor is it new for A = 3C/2: what that means is left to single jobs.
    "moments that name no term, and those with one more": 2,
    # g1 at the start is on the other side, or outside of its window.
    "a start": 4,
}
"""Points that are left to single jobs."""


@pytest.mark.one_in(3)
@pytest.mark.usefixtures("no_hurry")
@pytest.mark.parametrize("name", IN_SLICES)
def test_slices_of_a_sweep_go_in_blocks(name, monkeypatch):
    document = IN_SLICES[name]
    singly = []
    original = chunk.solve_point
    monkeypatch.setattr(
        chunk,
        "solve_point",
        lambda sweep, index, **judged: singly.append(index) or original(sweep, index, **judged),
    )
    points = decode_points(computed(document).data)
    together = {index for index in range(len(points.outcomes)) if index not in singly}
    # The first of each is compared with its single job.
    refusals = {"no_motion", "invalid_problem", "inadmissible_potential"}
    assert {points.outcomes[index] for index in together} <= {SOLVED, *refusals}
    assert len(together) > 1


@pytest.mark.usefixtures("no_hurry")
@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("any state", 1),
        ("moments, and what is no body", 5),
        ("moments in the formula", 1),
        ("functions, both ways in time", 1),
        ("too fine for doubles, states", 1),
    ],
)
def test_states_go_through_kernels_alone(name, count, monkeypatch):
    """Single jobs: the first of each outcome, for comparison, and what is no problem at all."""
    singly = []
    original = chunk.solve_point
    monkeypatch.setattr(
        chunk, "solve_point", lambda *point, **judged: singly.append(point) or original(*point, **judged)
    )
    outcome = computed(OF_STATES[name])
    assert outcome.count == read_sweep(OF_STATES[name]).points
    assert len(singly) == count


def test_numbers_of_a_potential_need_no_documents(monkeypatch):
    """But for one that is 1, with which the formula has one product less, and for two that are equal."""
    read = []
    original = states.read_problem
    monkeypatch.setattr(states, "read_problem", lambda document: read.append(document) or original(document))
    swept = read_sweep(OF_STATES["numbers of the potential that are folded, and equal ones"])
    solver = chunk.ChunkSolver(make_plan(swept))
    outcomes = solver.solve(0, swept.points, time.perf_counter() + 600.0).outcomes
    assert set(outcomes) == {SOLVED}
    assert len(read) < swept.points


@pytest.mark.parametrize(
    ("name", "is_judged"),
    [
        ("certified", True),
        ("orientation", True),
        ("admissible for one value", False),
        ("any state, with invariants", False),
    ],
)
def test_a_verdict_is_shared_only_if_it_is_proved_for_all(name, is_judged):
    assert make_plan(read_sweep(ONE_BY_ONE[name])).is_judged == is_judged


@pytest.mark.usefixtures("no_hurry")
def test_points_refused_one_by_one_share_a_verdict(monkeypatch):
    asked = []
    monkeypatch.setattr(cached, "decide", lambda *question: asked.append(question) or decide(*question))
    document = sweep(
        (B, values(0, 1, -1)),
        (LAMBDA, uniform(1, 2, 3)),
        potential=expression("-g1 + b*(b-1)*g2*exp(g1)", b=0),
    )
    outcomes = decode_points(computed(document).data).outcomes
    assert outcomes.count("inadmissible_potential") == 3
    # One for those, and one for the solved point that is compared with its job.
    assert len(asked) == 2


@pytest.mark.usefixtures("no_hurry")
def test_a_chunk_may_begin_anywhere():
    document = IN_BLOCKS["constants worked out from parameters"]
    whole, part = decode_points(computed(document).data), decode_points(computed(document, 3, 2).data)
    for name, numbers in part.numbers.items():
        assert np.array_equal(numbers, whole.numbers[name][3:5])
    for name, rows in part.series.items():
        assert np.array_equal(rows, whole.series[name][3:5])


@pytest.mark.parametrize("name", ["standard", "parameters and lambda", "no motion"])
def test_a_chunk_without_time_hands_back_at_least_one_point(name, monkeypatch):
    document = {**IN_BLOCKS, **ONE_BY_ONE}[name]
    monkeypatch.setattr(chunk, "MOST_CHUNK_SECONDS", 0.0)
    monkeypatch.setattr(chunk, "BLOCK_POINTS", 1)
    outcome = computed(document)
    assert outcome.count == 1
    assert len(decode_points(outcome.data).outcomes) == 1


@pytest.mark.usefixtures("no_hurry")
def test_blocks_that_differ_from_a_point_alone_are_not_used(monkeypatch):
    document = IN_BLOCKS["numbers alone"]
    expected = computed(document)
    chunk._solver_of.cache_clear()
    solver = chunk._solver_of(json.dumps(document), "compiled", waits=False)
    solve = solver._blocks.solve

    def off_by_one_ulp(first, count):
        block = solve(first, count)
        block.numbers["period"][:] = np.nextafter(block.numbers["period"], np.inf)
        return block

    monkeypatch.setattr(solver._blocks, "solve", off_by_one_ulp, raising=False)
    found = solver.solve(0, expected.count, time.perf_counter() + 60.0)
    assert np.array_equal(found.numbers["period"], decode_points(expected.data).numbers["period"])


def test_the_outcome_counts_refusals_and_bounds_its_numbers():
    outcome = computed(IN_BLOCKS["the end of the times"])
    assert (outcome.count, outcome.refused) == (4, 1)
    low, high = outcome.bounds["period"]
    assert low == high == decode_points(outcome.data).numbers["period"][0]


@pytest.mark.parametrize(
    ("accuracy", "stop", "way"),
    [
        ({"tolerance": "1e-9"}, 20, "compiled"),
        ({"tolerance": "1e-10"}, 20, "compiled"),
        ({"tier": "standard"}, 20, "compiled"),
        ({"tolerance": "1e-12"}, 20, "compiled"),
        # Late, that error of the period has added up: the kernel of high knows it in balls.
        ({"tolerance": "1e-9"}, 20_000, "compiled"),
    ],
)
def test_a_loose_tolerance_takes_a_single_job_the_way_of_blocks(accuracy, stop, way):
    document = read_sweep(sweep((LAMBDA, values("7/10")), accuracy=accuracy)).document(0)
    outcome = solve_checked(json.dumps({**document, "time": {"stop": stop, "samples": 5}}))
    assert way in outcome.summary["evidence"]
    assert outcome.summary["error"] <= float(accuracy.get("tolerance", "1e-10"))
