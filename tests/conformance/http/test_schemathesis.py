"""Requests that Schemathesis makes from the OpenAPI document, good ones, bad ones and whole sessions."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.conformance import operations
from tests.support.effort import examples

HERE = Path(__file__).parent
ALL_PHASES = "examples,coverage,fuzzing,stateful"


def run(service, folder: Path, phases: str, most: int) -> int:
    """Run it on all operations with all of its checks, and our own; return the number of requests."""
    command = [
        Path(sys.executable).with_name("schemathesis"),
        f"--config-file={HERE / 'schemathesis.toml'}",
        "run",
        service.address + "/openapi.json",
        f"--phases={phases}",
        f"--max-examples={most}",
        "--continue-on-failure",
        "--no-color",
        "--output-truncate=false",
        # Less than the 15 s between two signs of a stream of events, which is else read until its job ends.
        "--request-timeout=14",
        *(["--seed=1"] if os.environ.get("CI") == "true" else []),
    ]
    environment = {**os.environ, "SCHEMATHESIS_HOOKS": str(HERE / "checks.py")}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    told = done.stdout + done.stderr
    assert done.returncode == 0, told
    count = sum(1 for _ in operations())
    assert f"Tested: {count}\n" in told, told
    generated = re.search(r"(\d+) generated", told)
    assert generated is not None, told
    return int(generated[1])


def test_some_requests_of_every_operation_are_answered_as_the_document_says(service, tmp_path):
    # Two requests of each operation at least, and those of the examples and sessions.
    assert run(service, tmp_path, "examples,fuzzing,stateful", most=2) > 2 * sum(1 for _ in operations())


@pytest.mark.long
def test_many_requests_of_every_operation_are_answered_as_the_document_says(service, tmp_path):
    assert run(service, tmp_path, ALL_PHASES, most=examples(5, 50)) > examples(1000, 5000)


def test_the_service_still_answers_all_of_them(service):
    """Whatever was sent, nothing was broken: it is ready, and solves."""
    assert service.call("GET", "/readyz").document["status"] == "ok"
