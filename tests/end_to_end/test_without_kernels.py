"""A service whose kernels are never ready answers; what only kernels solve waits, and says why."""

import fcntl
import json

import pytest

from service.catalogue.classical import example_of
from service.dynamics.classical.catalogue import CASES
from service.jobs.kernels import WAITS
from tests.support.serving import serving
from tests.workers.processes import wait_until
from workers.computation.compiled_code import FOLDER_VARIABLE, WAY_VARIABLE

PLANAR = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 11},
    "outputs": ["period", "gamma", "omega", "invariants", "orientation", "stability"],
}
STATE = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "gravity", "a": -1},
    "motion": {"type": "state", "gamma": ["0.6", "0", "0.8"], "omega": ["0", "1", "0.1"]},
    "time": {"stop": 1, "samples": 3},
}
SWEEP = {
    "base": {**PLANAR, "outputs": ["period", "gamma", "omega"], "accuracy": {"tier": "draft"}},
    "axes": [{"pointer": "/motion/lambda", "linspace": [0.8, 1.2, 12]}],
    "keep": ["period", "energy"],
}


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    """A service with an empty folder for compiled code, whose compiling task waits for another for ever."""
    folder = tmp_path_factory.mktemp("without kernels")
    code = folder / "code"
    (code / "compiled").mkdir(parents=True, mode=0o700)
    with (code / "compiled" / "lock").open("w") as lock:
        fcntl.lockf(lock, fcntl.LOCK_EX)
        (code / "compiled" / "progress.json").write_text(json.dumps({"done": 41, "of": 190, "seconds": 50}))
        with serving(folder, **{FOLDER_VARIABLE: str(code), WAY_VARIABLE: ""}) as running:
            yield running


@pytest.mark.parametrize("tier", ["draft", "standard", "high", "certified"])
@pytest.mark.parametrize("method", ["auto", "quadrature"])
def test_planar_motions_of_all_tiers_are_solved_with_the_promise_of_their_tier(service, tier, method):
    solution, _ = service.solve({**PLANAR, "method": method, "accuracy": {"tier": tier}})
    assert solution["provenance"]["way"] == "plain"
    # What the tiers promise: docs/problems.md.
    assert solution["error"] <= {"draft": 1e-6, "standard": 1e-10, "high": 1e-13, "certified": 1e-15}[tier]


@pytest.mark.parametrize("name", CASES)
def test_classical_motions_are_solved(service, name):
    solution, _ = service.solve({**example_of(CASES[name]), "time": {"stop": 1, "samples": 3}})
    assert solution["provenance"]["way"] == "plain"


@pytest.mark.parametrize("tier", ["draft", "standard"])
def test_motions_from_a_state_are_solved(service, tier):
    solution, _ = service.solve({**STATE, "accuracy": {"tier": tier}})
    assert solution["evidence"]["integrator"] == "dop853"
    assert solution["error"] <= {"draft": 1e-6, "standard": 1e-10}[tier]


def test_what_only_kernels_solve_is_queued_and_says_why(service):
    job = service.call("POST", "/v1/jobs", {**STATE, "accuracy": {"tier": "high"}}).document["id"]
    wait_until(lambda: attempts(service, job) and attempts(service, job)[0]["outcome"] == "returned")
    assert attempts(service, job)[0]["detail"] == WAITS
    assert service.call("GET", f"/v1/jobs/{job}").document["state"] in ("queued", "running")
    assert service.call("POST", f"/v1/jobs/{job}/cancel").document["state"] == "cancelled"


def test_a_small_sweep_is_done_point_by_point_and_tells_its_way(service):
    sweep = service.call("POST", "/v1/sweeps", SWEEP).document["id"]
    wait_until(lambda: service.call("GET", f"/v1/sweeps/{sweep}").document["state"] == "succeeded")
    document = service.call("GET", f"/v1/sweeps/{sweep}").document
    assert (document["way"], document["refused"]) == ("plain", 0)


def test_the_service_tells_how_far_kernels_are(service):
    def told():
        return service.call("GET", "/readyz").document.get("compiling")

    wait_until(lambda: told() == {"done": 41, "of": 190, "seconds": 50.0})


def attempts(service, job):
    return service.call("GET", f"/v1/jobs/{job}/attempts").document["items"]
