"""Compiled code is kept in the folder that was handed in, and found there by the next process."""

import json
import os
import subprocess
import sys

import pytest

from service.jobs.outcome import Solved
from service.sandbox import Sandbox
from workers.computation.compiled_code import FOLDER_VARIABLE, digest, own_folder
from workers.computation.compute import solve_document
from workers.process.tasks import PRELOAD
from workers.solvers.compiled import code_folder

PROBLEM = {
    "body": {"A": "2", "C": "1"},
    "potential": {"type": "expression", "expression": "-g1"},
    "motion": {"type": "planar", "lambda": "1"},
    "time": {"stop": "1", "samples": 2},
    "accuracy": {"tier": "draft"},
}
CALLING = """
import sys
from workers.solvers.compiled import code_folder
when, *folder = sys.argv[1:]
if when == "before":
    code_folder.hand_in(*folder)
from workers.solvers.compiled.evaluation.interpreter import power
if when == "after":
    code_folder.hand_in(*folder)
assert power(3.0, 2.0) == 9.0
print(sum(power.stats.cache_hits.values()), sum(power.stats.cache_misses.values()))
"""


def call_a_kernel(folder, when):
    """Return how many kernels a fresh interpreter found compiled, and how many it compiled.

    ``when`` the folder is handed in: before or after kernels are loaded, or never.
    """
    result = subprocess.run(
        [sys.executable, "-c", CALLING, when, str(folder)],
        env={**os.environ, FOLDER_VARIABLE: str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )
    return tuple(map(int, result.stdout.split()))


def hits_after_solving(document):
    """Return how often the solver of a fresh child was found compiled; called in that child."""
    assert isinstance(solve_document(document), Solved)
    from workers.solvers.compiled.solve_set import solve_sets  # noqa: PLC0415

    return sum(solve_sets.stats.cache_hits.values())


@pytest.mark.parametrize("first", ["before", "after"])
@pytest.mark.parametrize("second", ["before", "after"])
def test_a_second_process_finds_what_the_first_has_compiled(tmp_path, first, second):
    assert call_a_kernel(tmp_path, first) == (0, 1)
    assert list(tmp_path.rglob("*power*"))
    assert call_a_kernel(tmp_path, second) == (1, 0)


def test_nothing_is_kept_where_no_folder_was_handed_in(tmp_path):
    # Not even in the folder that the compiler itself would take from the environment.
    assert call_a_kernel(tmp_path, "never") == (0, 1)
    assert list(tmp_path.iterdir()) == []


def test_the_children_of_a_worker_find_the_solver_compiled():
    document = json.dumps(PROBLEM)
    # Compiled here, if it is not yet.
    assert isinstance(solve_document(document), Solved)
    sandbox = Sandbox(1, preload=PRELOAD)
    try:
        assert sandbox.run(hits_after_solving, document, seconds=None) == 1
    finally:
        sandbox.close()


def test_no_second_folder_is_taken():
    # The tests have handed one in; it may be handed in as often as one likes.
    code_folder.hand_in(str(own_folder()))
    with pytest.raises(code_folder.OtherFolderError):
        code_folder.hand_in("elsewhere")


def test_the_folder_is_made_for_us_alone(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "new"))
    folder = own_folder()
    assert folder.parent == tmp_path / "new"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert own_folder() == folder


@pytest.mark.parametrize("mode", [0o770, 0o702])
def test_a_folder_that_others_may_write_to_is_not_taken(tmp_path, monkeypatch, mode):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    own_folder().chmod(mode)
    assert own_folder() is None


def test_without_a_folder_there_is_none(tmp_path, monkeypatch):
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setenv(FOLDER_VARIABLE, str(file))
    assert own_folder() is None


def test_the_folder_is_that_of_the_caches_where_none_is_named(tmp_path, monkeypatch):
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert own_folder().parent == tmp_path / "polhode"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert own_folder().parent == tmp_path / ".cache" / "polhode"


def test_the_folder_is_another_one_for_other_sources(tmp_path):
    room = tmp_path / "room"
    room.mkdir()
    (room / "one.py").write_text("x = 1")
    first = digest(tmp_path)
    assert digest(tmp_path) == first
    (room / "one.py").write_text("x = 2")
    second = digest(tmp_path)
    (room / "one.py").rename(room / "other.py")
    assert len({first, second, digest(tmp_path)}) == 3
