"""A service whose kernels are never ready answers; what only kernels solve waits, and says why."""

import fcntl
import json

import pytest

from service.catalogue import example_of
from service.dynamics.classical.bodies import CASES
from service.jobs.kernels import NEVER, WAITS
from service.local.workers import FOLDER_VARIABLE
from tests.support.serving import serving
from tests.support.waiting import wait_until
from workers.computation.compiled_code import WAY_VARIABLE

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


@pytest.fixture(scope="module")
def in_vain(tmp_path_factory):
    """A service whose compiling task fails: where its lock should be is a folder."""
    folder = tmp_path_factory.mktemp("in vain")
    (folder / "code" / "compiled").mkdir(parents=True, mode=0o700)
    (folder / "code" / "compiled" / "lock").mkdir()
    with serving(folder, **{FOLDER_VARIABLE: str(folder / "code"), WAY_VARIABLE: ""}) as running:
        wait_until(lambda: "kernels" in running.call("GET", "/readyz").document["checks"])
        yield running


# Rows are gone through in one test each: every process that has one of the tests starts such a service.
def test_planar_motions_of_all_tiers_are_solved_with_the_promise_of_their_tier(service):
    # What the tiers promise: docs/problems.md.
    for tier, promised in {"draft": 1e-6, "standard": 1e-10, "high": 1e-13, "certified": 1e-15}.items():
        for method in ("auto", "quadrature"):
            solution, _ = service.solve({**PLANAR, "method": method, "accuracy": {"tier": tier}})
            assert solution["provenance"]["way"] == "plain"
            assert solution["error"] <= promised


def test_classical_motions_are_solved(service):
    for case in CASES.values():
        solution, _ = service.solve({**example_of(case), "time": {"stop": 1, "samples": 3}})
        assert solution["provenance"]["way"] == "plain"


def test_motions_from_a_state_are_solved(service):
    for tier, promised in {"draft": 1e-6, "standard": 1e-10}.items():
        solution, _ = service.solve({**STATE, "accuracy": {"tier": tier}})
        assert solution["evidence"]["integrator"] == "dop853"
        assert solution["error"] <= promised


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

    wait_until(lambda: told() == {"done": 41, "of": 190, "seconds": 50.0, "waits": None})


def test_where_compiling_fails_the_plain_way_is_final_and_says_so(in_vain):
    told = in_vain.call("GET", "/readyz").document
    assert told["checks"]["kernels"].startswith("not compiled: compiled code cannot be kept")
    assert "compiling" not in told
    high = {**STATE, "accuracy": {"tier": "high"}}
    job = in_vain.call("POST", "/v1/jobs", high, Prefer="wait=60").document
    assert (job["state"], job["error"]["code"]) == ("failed", "accuracy_not_met")
    assert job["error"]["detail"].endswith(NEVER)
    solution, _ = in_vain.solve({**STATE, "accuracy": {"tier": "standard"}})
    assert solution["provenance"]["way"] == "plain"
    axes = [{"pointer": "/motion/omega/0", "values": [0, "1/10"]}]
    sweep = in_vain.call("POST", "/v1/sweeps", {"base": high, "axes": axes, "keep": ["energy"]}).document[
        "id"
    ]
    wait_until(lambda: in_vain.call("GET", f"/v1/sweeps/{sweep}").document["state"] == "succeeded")
    done = in_vain.call("GET", f"/v1/sweeps/{sweep}").document
    assert (done["way"], done["refused"]) == ("plain", 2)


def attempts(service, job):
    return service.call("GET", f"/v1/jobs/{job}/attempts").document["items"]
