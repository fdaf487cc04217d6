"""What a worker solves before its first job loads what the first job needs."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from service.dynamics.accuracy import TIERS
from service.jobs.records import Refused
from service.local.workers import FOLDER_VARIABLE
from tests.support.commands import polhode
from workers.computation import compiled_code
from workers.sweeping import warming

ROOT = Path(__file__).parents[3]
POTENTIAL = {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -2, "b": "1/9"}}
FIRST_JOBS = [
    {
        "body": {"A": "2", "C": "1"},
        "potential": POTENTIAL,
        "motion": {"type": "planar", "lambda": "6/5"},
        "time": {"periods": 3, "samples": 31},
        "accuracy": {"tier": tier},
    }
    for tier in ("draft", "standard", "high")
]
IN_A_CHILD = """
import sys
from service.sandbox import Sandbox
from tests.support.loaded_code import loaded_by
from workers.process.tasks import PRELOAD
sandbox = Sandbox(1, preload=PRELOAD)
sandbox.start()
print(sandbox.run(loaded_by, sys.argv[1], seconds=None))
sandbox.close()
"""
THREADS = """
import workers.sweeping.warming as warming
from tests.support.loaded_code import threads
before = threads()
warming.warm_up_before_forks()
print(threads() - before)
"""


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    """Compile what is not compiled yet, and note it."""
    warming.warm_up()
    assert warming.is_compiled()


def printed(code, *arguments):
    result = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(result.stdout)


def test_the_first_jobs_of_a_child_load_no_compiled_code():
    # The fork server has loaded it, for a child that replaces a killed one too.
    before, more = printed(IN_A_CHILD, json.dumps(FIRST_JOBS))
    assert before > 0
    assert more == 0


def test_the_fork_server_starts_no_thread_which_no_child_would_inherit():
    assert printed(THREADS) == 0


def test_every_tier_is_warmed():
    assert {problem["accuracy"]["tier"] for problem in warming.PROBLEMS.values()} == set(TIERS)


def test_a_problem_that_is_refused_is_named_by_workers_and_by_compile(monkeypatch, capsys, tmp_path):
    refused = Refused({"code": "no_motion", "detail": "there is none"})
    monkeypatch.setattr(warming, "solve_document", lambda _, way: refused)
    with pytest.raises(warming.WarmingError, match="draft: no_motion: there is none"):
        warming.warm_up()
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setattr(compiled_code, "_ready", set())
    assert polhode("compile") == 1
    assert "draft: no_motion: there is none" in capsys.readouterr().err


def test_a_group_is_noted_when_all_of_it_is_solved(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setattr(warming, "note_of", lambda group: tmp_path / group)
    asked = []

    def solve(text, way):
        asked.append(way)
        return Refused({"code": "x", "detail": "y"}) if len(asked) == 3 else None

    monkeypatch.setattr(warming, "solve_document", solve)
    with pytest.raises(warming.WarmingError, match="high: x: y"):
        warming.compile_group("planar")
    assert not (tmp_path / "planar").exists()
    warming.compile_group("planar")
    assert (tmp_path / "planar").exists()
    assert set(asked) == {"compiled"}
