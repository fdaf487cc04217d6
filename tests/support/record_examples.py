"""Records the examples of answers in the OpenAPI document: ``python -m tests.support.record_examples``.

Runs a service on an empty database, asks it once for everything, and writes what it answers to
``service/api/examples.json``. Names of this machine are replaced, and long lists are cut.
"""

import json
import re
import tempfile
import time
import urllib.request
from pathlib import Path

from service.api.descriptions import RECORDED
from tests.support.serving import serving

BODY = {"A": 2, "B": "3/2", "C": 1}
POTENTIAL = {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}}
PROBLEM = {
    "body": BODY,
    "potential": POTENTIAL,
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 3},
}
CERTIFIED = {**PROBLEM, "time": {"stop": 1, "samples": 2}, "accuracy": {"tier": "certified"}}
SWEEP = {
    "base": {**PROBLEM, "accuracy": {"tolerance": 1e-9}},
    "axes": [{"pointer": "/motion/lambda", "values": ["3/4", 1]}],
    "keep": ["period", "energy", "error"],
}
ATLAS = {
    "body": {"A": 2, "C": 1},
    "potential": {
        "type": "expression",
        "expression": "a*g1 + b/g3^2 + c*(g1^2 - g2^2)",
        "parameters": {"a": -1, "b": "1/20", "c": "3/2"},
    },
    "lambda": ["9/10", "11/10"],
    "samples": 9,
}
SEARCH = {
    "base": {
        "body": {"A": 2, "C": 1},
        "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"},
        "motion": {"type": "planar"},
    },
    "unknowns": [{"pointer": "/motion/lambda", "interval": ["99/100", "101/100"]}],
    "wanted": [{"of": "energy", "equals": "2/5"}],
}
INTEGRAL = {
    "body": {"A": 2, "B": 2, "C": 1},
    "potential": {"type": "expression", "expression": "g1"},
    "function": "(p^2 - q^2 - g1)^2 + (2*p*q - g2)^2",
}
INTEGRALS = {
    "body": {"A": 2, "B": 2, "C": 1},
    "potential": {"type": "expression", "expression": "g1"},
    "degree": {"omega": 2, "gamma": 1},
}
LONG = {"families": 1, "classical": 1, "rows": 1, "shapes": 1}
"""Lists of these names are cut to so many items."""
JSON, CSV, NDJSON = "application/json", "text/csv", "application/x-ndjson"


class Recorder:
    def __init__(self, address: str) -> None:
        self.address = address
        self.found: dict[str, dict[str, dict[str, dict[str, object]]]] = {}

    def record(self, operation: str, name: str, method: str, path: str, document=None, **headers: str):
        body = None if document is None else json.dumps(document).encode()
        sent = {"Content-Type": JSON, "Accept": JSON, **headers}
        request = urllib.request.Request(self.address + path, data=body, headers=sent, method=method)
        with urllib.request.urlopen(request, timeout=120) as answer:
            status, text = answer.status, answer.read().decode()
            media_type = answer.headers.get("Content-Type", "").partition(";")[0]
        value = json.loads(text) if media_type == JSON else text
        if text and operation:
            shown = cut(json.loads(anonymous(json.dumps(value))))
            named = (
                self.found.setdefault(operation, {}).setdefault(str(status), {}).setdefault(media_type, {})
            )
            named[name] = shown
        return value


def anonymous(text: str) -> str:
    """Replace the names of hosts and workers, also where they are quoted as in a URL."""
    for slash, colon in (("/", ":"), ("%2F", "%3A")):
        text = re.sub(
            rf"[\w.-]+{slash}[0-9a-f]{{8}}({colon}\d+{colon}[0-9a-f]{{8}})?\b(?!-)",
            lambda name, s=slash, c=colon: f"laptop{s}1b2e6a1f{f'{c}1{c}9c3d5e70' if name[1] else ''}",
            text,
        )
    return text


def cut(value: object) -> object:
    if isinstance(value, dict):
        return {
            name: cut(each[: LONG[name]] if name in LONG and isinstance(each, list) else each)
            for name, each in value.items()
        }
    return [cut(each) for each in value] if isinstance(value, list) else value


def record_studies(recorder: Recorder) -> None:
    record = recorder.record
    record("search_numbers", "an answer", "POST", "/v1/searches", SEARCH, Prefer="wait=60")
    study = record("search_numbers", "a job", "POST", "/v1/searches", SEARCH, Prefer="respond-async")
    while record("", "", "GET", f"/v1/jobs/{study['id']}")["state"] != "succeeded":
        time.sleep(0.1)
    record("get_result", "of a search", "GET", f"/v1/jobs/{study['id']}/result")
    for operation, path, document in (
        ("judge_integral", "/v1/integrals", INTEGRAL),
        ("search_integrals", "/v1/integrals/searches", INTEGRALS),
        ("search_potentials", "/v1/potentials/searches", {"degree": 1}),
    ):
        record(operation, "an answer", "POST", path, document)
        record(operation, "a job", "POST", path, document, Prefer="respond-async")


def ask(recorder: Recorder) -> None:
    record = recorder.record
    for operation, path in (
        ("get_liveness", "/livez"),
        ("get_readiness", "/readyz"),
        ("get_accuracy", "/v1/accuracy"),
        ("list_families", "/v1/families"),
    ):
        record(operation, "answer", "GET", path)
    metrics = (
        urllib.request.urlopen(recorder.address + "/metrics", timeout=60).read().decode().splitlines(True)
    )
    recorder.found["get_metrics"] = {"200": {"text/plain": {"beginning": "".join(metrics[:6])}}}
    setting = {"body": BODY, "potential": POTENTIAL, "motion": PROBLEM["motion"]}
    record("validate", "admissible", "POST", "/v1/validations", setting)
    refuted = {"body": BODY, "potential": {"type": "expression", "expression": "g1 + g2/10"}}
    record("validate", "inadmissible", "POST", "/v1/validations", refuted)
    record("draw_atlas", "one window", "POST", "/v1/atlases", ATLAS)
    record("draw_atlas", "one window", "POST", "/v1/atlases", ATLAS, Accept=CSV)
    drawn = record("draw_atlas", "by a job", "POST", "/v1/atlases", ATLAS, Prefer="respond-async, wait=60")
    record("get_atlas", "one window", "GET", f"/v1/atlases/{drawn['atlas']}")
    record("get_atlas", "one window", "GET", f"/v1/atlases/{drawn['atlas']}", Accept=CSV)
    record("list_atlases", "a page", "GET", "/v1/atlases?limit=1")
    record_studies(recorder)
    record("submit_job", "a job", "POST", "/v1/jobs", CERTIFIED)
    job = record("submit_job", "finished in time", "POST", "/v1/jobs", PROBLEM, Prefer="wait=60")
    record("submit_job", "of a list", "POST", "/v1/jobs", [PROBLEM, {**PROBLEM, "body": {"A": 0, "C": 1}}])
    record("submit_job", "an estimate", "POST", "/v1/jobs?estimate=true", CERTIFIED)
    record("submit_sweep", "an estimate", "POST", "/v1/sweeps?estimate=true", SWEEP)
    certified = record("", "", "POST", "/v1/jobs", CERTIFIED, Prefer="wait=60")
    solution = f"/v1/solutions/{job['solution']}"
    record("get_job", "finished", "GET", f"/v1/jobs/{job['id']}")
    record("get_attempts", "one", "GET", f"/v1/jobs/{job['id']}/attempts")
    record("list_jobs", "a page", "GET", "/v1/jobs?limit=1")
    record("list_jobs", "columns", "GET", "/v1/jobs?limit=2&columns=id,state,seconds")
    record("get_job_facets", "states", "GET", "/v1/jobs/facets?by=state")
    record("get_job_statistics", "seconds", "GET", "/v1/jobs/statistics?of=seconds&bins=2")
    record("get_solution", "a solution", "GET", solution)
    record("get_trajectory", "stored", "GET", f"{solution}/trajectory")
    record("get_trajectory", "stored", "GET", f"{solution}/trajectory", Accept=CSV)
    record("get_trajectory", "stored", "GET", f"{solution}/trajectory", Accept=NDJSON)
    record("get_function", "a function of time", "GET", f"{solution}/function")
    record("get_trajectory", "a preview", "GET", f"{solution}/trajectory?preview=5&columns=t,g1")
    record("get_provenance", "of a solution", "GET", f"{solution}/provenance")
    audit = record("audit_solution", "queued", "POST", f"{solution}/audits", {"accuracy": {"tier": "high"}})
    audits = f"{solution}/audits"
    record("audit_solution", "finished in time", "POST", audits, {}, Prefer="wait=60")
    record("list_audits", "a page", "GET", f"{audits}?limit=1")
    record("get_audit", "of another tier", "GET", f"{audits}/{audit['id']}")
    record("get_citation", "of a solution", "GET", f"{solution}/citation", Accept="application/x-bibtex")
    record("get_citation", "of a solution", "GET", f"{solution}/citation", Accept="application/yaml")
    marks = {"labels": {"project": "thesis"}, "note": "the first one"}
    record("change_solution", "labels and a note", "PATCH", solution, marks)
    record("change_job", "labels and a note", "PATCH", f"/v1/jobs/{job['id']}", marks)
    record("get_enclosures", "two times", "GET", f"/v1/solutions/{certified['solution']}/enclosures")
    record("list_solutions", "a page", "GET", "/v1/solutions?limit=1&order=period")
    digest = record("", "", "GET", "/v1/solutions?columns=digest&limit=1")["items"][0]["digest"]
    record("list_problem_solutions", "a page", "GET", f"/v1/problems/{digest}/solutions")
    record("get_solution_facets", "tiers", "GET", "/v1/solutions/facets?by=tier")
    record("get_solution_statistics", "periods", "GET", "/v1/solutions/statistics?of=period&bins=2")
    sweep = record("submit_sweep", "a sweep", "POST", "/v1/sweeps", SWEEP)
    path = f"/v1/sweeps/{sweep['id']}"
    while record("get_sweep", "finished", "GET", path)["state"] != "succeeded":
        time.sleep(0.1)
    record("change_sweep", "labels and a note", "PATCH", path, marks)
    record("get_grid", "a row", "GET", f"{path}/grid?of=period")
    record("list_sweeps", "a page", "GET", "/v1/sweeps?limit=1")
    record("list_sweep_jobs", "a page", "GET", f"{path}/jobs?limit=1")
    record("get_sweep_provenance", "of a sweep", "GET", f"{path}/provenance")
    lists = {
        "list_jobs": "/v1/jobs?limit=1",
        "list_atlases": "/v1/atlases?limit=1",
        "list_solutions": "/v1/solutions?limit=1",
        "list_audits": f"{audits}?limit=1",
        "list_problem_solutions": f"/v1/problems/{digest}/solutions?limit=1",
        "list_sweeps": "/v1/sweeps?limit=1",
        "list_sweep_jobs": f"{path}/jobs?limit=1",
    }
    for operation, place in lists.items():
        for media_type in (CSV, NDJSON):
            record(operation, "a row", "GET", place, Accept=media_type)
    for media_type in (JSON, CSV, NDJSON):
        record("get_points", "two points", "GET", f"{path}/points", Accept=media_type)
    record("get_point_facets", "outcomes", "GET", f"{path}/points/facets?by=outcome")
    record("get_point_statistics", "periods", "GET", f"{path}/points/statistics?of=period")
    record("get_status", "now", "GET", "/v1/status")
    long = {**SWEEP, "axes": [{"pointer": "/motion/lambda", "linspace": ["1/2", 2, 10**6]}]}
    begun = record("", "", "POST", "/v1/sweeps", long)
    record("cancel_sweep", "cancelled", "POST", f"/v1/sweeps/{begun['id']}/cancel")
    queued = record("", "", "POST", "/v1/jobs", {**PROBLEM, "time": {"stop": 11, "samples": 10**5}})
    record("cancel_job", "cancelled", "POST", f"/v1/jobs/{queued['id']}/cancel")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder)) as service:
        recorder = Recorder(service.address)
        ask(recorder)
    text = json.dumps(recorder.found, indent=1, ensure_ascii=False, sort_keys=True)
    RECORDED.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
