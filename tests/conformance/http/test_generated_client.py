"""A client that openapi-python-client generates from the document submits a job and reads its samples."""

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.record_examples import PROBLEM

DOCUMENT = Path(__file__).parents[3] / "docs" / "openapi.json"
NAME = "generated_polhode_client"


@pytest.fixture
def generated(tmp_path, monkeypatch):
    """Return a function that imports a module of the client."""
    binaries = Path(sys.executable).parent
    command = [
        binaries / "openapi-python-client",
        "generate",
        f"--path={DOCUMENT}",
        f"--output-path={tmp_path / NAME}",
        "--meta=none",
        f"--config={tmp_path / 'config.json'}",
        "--fail-on-warning",  # of what it would leave out
    ]
    # It knows text and files, and takes these kinds of them for unknown.
    kinds = {"application/x-bibtex": "text/plain", "application/zip": "application/octet-stream"}
    (tmp_path / "config.json").write_text(json.dumps({"content_type_overrides": kinds}))
    # It formats what it writes, with what it finds on the path.
    path = f"{binaries}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        command, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    monkeypatch.syspath_prepend(tmp_path)
    yield lambda name: importlib.import_module(f"{NAME}.{name}")
    for name in [name for name in sys.modules if name.partition(".")[0] == NAME]:
        del sys.modules[name]


def test_a_generated_client_submits_a_job_and_reads_its_samples(generated, service):
    with generated("client").Client(base_url=service.address, timeout=60) as client:
        problem = generated("models.job_in").JobIn.from_dict(PROBLEM)
        submit = generated("api.jobs.submit_job").sync
        job = submit(client=client, body=problem, prefer="wait=60")
        assert job.state == "succeeded"
        solution = generated("api.solutions.get_solution").sync(job.solution, client=client)
        trajectory = generated("api.solutions.get_trajectory").sync(job.solution, client=client)
        refused = submit(client=client, body=generated("models.job_in").JobIn.from_dict(FLAT))
    columns = trajectory.columns.to_dict()
    assert columns["t"] == [0.0, 5.0, 10.0]
    lengths = [sum(columns[name][k] ** 2 for name in ("g1", "g2", "g3")) for k in range(3)]
    # γ is a unit vector; each component has the error that is told, and |γ|² at most 2√3 times that.
    assert lengths == pytest.approx([1.0] * 3, abs=4 * solution.error + 1e-15)
    path = f"/v1/solutions/{job.solution}/trajectory"
    assert columns == service.call("GET", path).document["columns"]
    assert [(fault.pointer, fault.code) for fault in refused.errors] == [("/body/A", "invalid_inertia")]


FLAT = {**PROBLEM, "body": {"A": 0, "C": 1}}
"""A problem that is refused."""
