"""Provenance tells processors apart by what libraries choose their instructions by."""

import base64
import json
import subprocess
import sys
from functools import cache
from pathlib import Path
from random import Random

from service.jobs.records import Solved, SolveOutcome
from service.sandbox import Sandbox
from service.schemas.problem.problem import check_problem, problem_digest
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from tests.support.api import STATE
from tests.support.other_processor import environment, masks
from workers.cli.doctor import repeat_solutions
from workers.computation import compiled_code as processor
from workers.computation.audit import Sameness
from workers.computation.compute import solve_document
from workers.computation.summary import provenance

ROOT = Path(__file__).parents[2]
SOLVE = """
import base64, json, sys
from workers.computation.compute import solve_document
found = solve_document(sys.argv[1], way="plain")
packets = found.dense, found.samples
print(json.dumps([found.summary, *(base64.b64encode(packet).decode() for packet in packets)]))
"""


@cache
def solved_elsewhere() -> SolveOutcome:
    """Solve a problem in a process that sees a processor with fewer features.

    The plain way: for kernels, which would be compiled for that processor, there is ``make test-portable``.
    """
    ran = subprocess.run(
        [sys.executable, "-c", SOLVE, json.dumps(STATE)],
        cwd=ROOT, env=environment(), capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    summary, dense, samples = json.loads(ran.stdout)
    return Solved(summary, base64.b64decode(dense), base64.b64decode(samples))


def test_a_solution_tells_what_computed_it():
    summary = solve_document(json.dumps(STATE)).summary
    assert summary["provenance"] == provenance()
    assert summary["provenance"]["processor"] == processor.processor()
    assert "numpy" in summary["provenance"]["libraries"]


def test_the_threads_are_those_that_the_library_uses():
    library = processor._openblas().scipy_openblas_set_num_threads64_
    before = processor.threads()
    try:
        for count in (1, 2):
            library(count)
            assert processor.threads() == provenance()["threads"] == count
    finally:
        library(before)


def test_other_features_are_another_processor_with_the_same_libraries():
    here, there = provenance(), solved_elsewhere().summary["provenance"]
    assert there["processor"] != here["processor"]
    # How many threads there are is up to the environment of each process.
    assert there["threads"] >= 1
    assert there["way"] == "plain"
    differing = ("processor", "threads", "way")
    assert {**there, **dict.fromkeys(differing)} == {**here, **dict.fromkeys(differing)}


def test_hidden_features_are_told(monkeypatch):
    for name, value in masks().items():
        monkeypatch.setenv(name, value)
    processor.processor.cache_clear()
    try:
        assert "NUMBA_CPU_NAME=generic" in processor.processor()
        assert "GLIBC_TUNABLES=" in processor.processor()
    finally:
        processor.processor.cache_clear()


def test_the_features_of_the_processor_are_those_that_numpy_uses(monkeypatch):
    config = {"SIMD Extensions": {"baseline": ["X"], "found": ["Y", "Z"], "not found": []}}
    monkeypatch.setattr(processor.np, "show_config", lambda mode: config)
    processor.processor.cache_clear()
    try:
        assert " Y Z" in processor.processor()
    finally:
        processor.processor.cache_clear()


def test_what_another_processor_solved_is_clean_here(sqlite_url):
    """As with workers on unlike hosts: whichever solved a problem, all others confirm its numbers."""
    database, sandbox = Database(sqlite_url), Sandbox(1, preload=["workers.computation.compute"])
    try:
        jobs = JobStore(database)
        jobs.submit(STATE, problem_digest(check_problem(STATE).canonical))
        claim = jobs.claim("elsewhere", lease_seconds=60.0)
        assert jobs.finish(claim, solved_elsewhere())[0]
        (repetition,) = repeat_solutions(database, sandbox, count=1, seconds=60.0, random=Random(1))
    finally:
        sandbox.close()
        database.close()
    assert repetition.sameness is Sameness.WITHIN_ERRORS
    assert repetition.is_clean
    assert "with another processor" in repetition.detail
