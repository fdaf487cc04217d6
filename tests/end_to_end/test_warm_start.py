"""The service says that it serves, then that its workers are warm; a job that comes between is computed."""

import json

from tests.support.serving import serving
from tests.support.waiting import wait_until

PROBLEM = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "gravity", "a": -1},
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 1, "samples": 3},
}


def test_a_service_is_warm_when_it_says_so(tmp_path):
    log = tmp_path / "log"

    def said():
        return [json.loads(line)["message"] for line in log.read_text().splitlines()]

    with log.open("wb") as stderr, serving(tmp_path, stderr=stderr, POLHODE_LOG_FORMAT="json") as service:
        early = service.call("GET", "/readyz").document
        first = service.call("POST", "/v1/jobs", PROBLEM).document
        wait_until(lambda: any("warm after" in line for line in said()))
        wait_until(lambda: service.call("GET", "/readyz").document["workers"] == "warm")
        wait_until(lambda: any("workers are warm" in line for line in said()))
        ours = [line.split(":")[0] for line in said() if "serving http" in line or "workers are warm" in line]
        assert ours == ["serving http", "the workers are warm"]
        wait_until(lambda: service.call("GET", f"/v1/jobs/{first['id']}").document["state"] == "succeeded")
    assert early["workers"] in ("starting", "warm")
    assert service.process.returncode == 0
