"""After ``polhode compile`` no job needs a kernel, for whatever types of its arguments, that is not there."""

import json
from pathlib import Path

import numpy as np
import pytest

from service.dynamics.accuracy import TIERS
from service.jobs.records import Solved
from service.sandbox import Sandbox
from service.schemas.reading.documents import InvalidProblemError
from service.schemas.sweep.reading import read_sweep
from tests.conformance.specimens import CATALOGUE
from tests.support.effort import one_in
from tests.workers.sweeping.test_sweeping import IN_BLOCKS, IN_MOVING
from workers.computation.compiled_code import keep_compiled_code
from workers.computation.compute import solve_document
from workers.solvers.compiled.evaluation.interpreter import power
from workers.solvers.ways import NotReadyError
from workers.sweeping.chunk import compute_chunk

EXAMPLES = Path(__file__).parents[3] / "examples"
SINGLE = [
    file
    for file in sorted(EXAMPLES.glob("*.json"))
    if file.stem not in ("sweep", "atlas", "search", "printed-a3")  # the last one is inadmissible
]
EVERYTHING = ["period", "gamma", "omega", "invariants", "orientation", "stability"]


@pytest.fixture(scope="module")
def child():
    """A child as workers have them: it does not compile."""
    sandbox = Sandbox(1, preload=["workers.sweeping.chunk"])
    yield sandbox
    sandbox.close()


def attempt(text):
    """Solve a problem by kernels, or refuse it; one that is missing is an error. Called in the child."""
    try:
        return isinstance(solve_document(text, way="compiled"), Solved)
    except InvalidProblemError:
        return False


@pytest.mark.parametrize("specimen", CATALOGUE, ids=str)
def test_the_catalogue_at_every_tier_with_every_output(child, specimen):
    body = {**specimen.document["body"], "B": specimen.document["body"]["A"]}
    few = {"body": body, "outputs": EVERYTHING, "time": {"stop": 1, "samples": 3}}
    done = [
        child.run(attempt, json.dumps({**specimen.document, **few, "accuracy": {"tier": tier}}), seconds=None)
        for tier in TIERS
    ]
    # Not every motion is certified.
    assert all(done[:3])


@pytest.mark.parametrize("file", SINGLE, ids=lambda file: file.stem)
@pytest.mark.parametrize("method", ["auto", "both", "integration"])
def test_the_examples_by_every_method(child, file, method):
    is_done = child.run(attempt, json.dumps({**json.loads(file.read_text()), "method": method}), seconds=None)
    # A body without B is not integrated.
    assert is_done or method != "auto"


@pytest.mark.parametrize("tier", ["draft", "standard", "high"])
def test_sweeps_in_blocks_of_numbers_bodies_and_states(child, tier):
    planar = json.loads((EXAMPLES / "first.json").read_text()) | {"accuracy": {"tier": tier}}
    state = json.loads((EXAMPLES / "state.json").read_text()) | {"accuracy": {"tier": tier}}
    for base, pointer, values, refused in (
        (planar, "/motion/lambda", [1, "6/5", "7/5"], 0),
        # The potential is admissible for the first body only.
        (planar, "/body/C", [1, "11/10"], 1),
        (planar, "/potential/parameters/a", [-1, -2], 0),
        (state, "/motion/omega/0", [0, "1/10", "2/10"], 0),
    ):
        sweep = {"base": base, "axes": [{"pointer": pointer, "values": values}], "keep": ["energy", "error"]}
        asked = {"sweep": sweep, "first": 0, "count": len(values), "way": "compiled"}
        assert child.run(compute_chunk, json.dumps(asked), seconds=None).refused == refused


@pytest.mark.parametrize("name", one_in(8, [*IN_BLOCKS, *IN_MOVING]))
def test_all_kinds_of_sweeps_in_blocks(child, name):
    document = {**IN_BLOCKS, **IN_MOVING}[name]
    count = min(64, read_sweep(document).points)
    asked = {"sweep": document, "first": 0, "count": count, "way": "compiled"}
    assert child.run(compute_chunk, json.dumps(asked), seconds=None).count


def test_the_child_does_not_compile(child):
    """Else the tests above would find nothing."""
    with pytest.raises(NotReadyError):
        child.run(call_with_other_types, seconds=None)


def call_with_other_types():
    """Call a kernel with types of arguments that no job has."""
    keep_compiled_code()
    power(np.float32(3.0), np.float32(2.0))
