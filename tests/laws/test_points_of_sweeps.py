"""Whatever a sweep varies, at whatever accuracy: a point has every bit of its own job, and ends alike."""

import json
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.jobs.records import Refused
from service.schemas.sweep.reading import read_sweep
from service.schemas.sweep.sweep import kept_numbers
from service.storage.codecs.packing import SOLVED, decode_arrays, decode_points
from tests.support.admissible import Case, cases
from tests.support.effort import examples
from workers.computation.compute import solve_checked
from workers.sweeping import chunk
from workers.sweeping.chunk import compute_chunk
from workers.sweeping.plan import make_plan

KEPT = ("period", "period.error", "energy", "energy.error", "error")
ACCURACIES = [{"tier": "draft"}, {"tolerance": "1e-9"}, {"tier": "standard"}, {"tier": "high"}]
TIMES = [{"stop": 5, "samples": 4}, {"periods": "7/3", "samples": 4}]
OUTPUTS = {
    None: (),
    ("period", "gamma", "omega", "invariants"): (
        "invariants.energy.drift",
        "invariants.geometric.drift",
        "invariants.areas.drift",
    ),
    ("omega", "stability"): ("stability.trace", "stability.trace.error", "stability.trusted_time"),
    ("orientation", "stability"): ("precession.psi1", "precession.psi3.error", "stability.exponent"),
}
"""Asked for, and what is kept of them besides."""
AXES = ["/motion/lambda", "/motion/start/g1", "/body/B", "/potential/parameters/k"]


@pytest.fixture(autouse=True)
def no_hurry(monkeypatch):
    """Nothing ends a chunk but its last point."""
    monkeypatch.setattr(chunk, "MOST_CHUNK_SECONDS", 600.0)
    chunk._solver_of.cache_clear()


def sweep(
    case: Case, pointer: str, values: list[Fraction], outputs: tuple[str, ...] | None, **rest: object
) -> dict[str, object]:
    rest |= {} if outputs is None else {"outputs": list(outputs)}
    motion = case.motion
    signs = {"g1_sign": motion.g1_sign, "g3_sign": motion.g3_sign, "window": motion.window}
    start = {"start": {"g1": str(motion.g1_sign * values[0])}} if pointer.endswith("g1") else {}
    sign = motion.g1_sign if start else 1
    return {
        "base": {
            "body": {"A": str(case.A), "B": str(case.A + case.C), "C": str(case.C)},
            "potential": {
                "type": "expression",
                "expression": f"k^2*({case.text})",
                "parameters": {"k": "1/2"},
            },
            "motion": {"type": "planar", "lambda": str(motion.lambda_), **signs, **start},
            **rest,
        },
        "axes": [{"pointer": pointer, "values": [str(sign * value) for value in values]}],
        "keep": [*KEPT, *OUTPUTS[outputs]],
        "series": "orientation" not in (outputs or ()),
    }


@given(
    cases(),
    st.sampled_from(AXES),
    st.lists(st.fractions(Fraction(1, 10), 1, max_denominator=997), min_size=3, max_size=3, unique=True),
    st.sampled_from(ACCURACIES),
    st.sampled_from(TIMES),
    st.sampled_from(list(OUTPUTS)),
)
@settings(max_examples=examples(4, 100), deadline=None)
def test_a_point_has_every_bit_of_its_own_job(case, pointer, values, accuracy, time, outputs):
    if pointer == "/body/B":
        # No body has all of them.
        values = [case.A + case.C - value for value in values[:2]] + [2 * (case.A + case.C)]
    document = sweep(case, pointer, values, outputs, accuracy=accuracy, time=time)
    swept = read_sweep(document)
    # The finest tier has compiled code for rational potentials of bodies with A = 2C alone.
    assert make_plan(swept).rows is not None or accuracy == {"tier": "high"}
    points = decode_points(
        compute_chunk(json.dumps({"sweep": document, "first": 0, "count": swept.points})).data
    )
    for index in range(swept.points):
        alone = solve_checked(json.dumps(swept.document(index)), explains=False)
        if isinstance(alone, Refused):
            assert points.outcomes[index] == alone.error["code"]
            continue
        assert points.outcomes[index] == SOLVED
        numbers = [points.numbers[name][index] for name in swept.keep]
        assert np.array_equal(numbers, kept_numbers(alone.summary, swept.keep), equal_nan=True)
        series = decode_arrays(alone.samples)
        for column in swept.series_columns:
            row = points.series[column][index]
            assert np.array_equal(row[~np.isnan(row)], series[column]), column
