"""Compiled code is found by its content, from any folder; where it is missing nothing compiles by the way."""

import ast
import importlib
import json
import os
import pkgutil
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import workers
from service.jobs.kernels import NeedsKernelsError
from service.jobs.records import Solved
from service.local.workers import FOLDER_VARIABLE, own_folder, why_no_folder
from service.sandbox import Sandbox
from service.verdicts.questions import examine_atlas_of_job
from tests.support.effort import each_once
from workers.computation import compiled_code, compute
from workers.computation.atlases import draw_document, with_stability
from workers.computation.compiled_code import (
    GROUPS,
    note_of,
    reached,
    stamp,
    take_shipped_code,
    trim,
    way_for,
)
from workers.computation.compute import solve_document
from workers.process.tasks import PRELOAD
from workers.solvers import compiled
from workers.solvers.compiled.kernels import Kernel
from workers.solvers.errors import AccuracyNotMetError
from workers.sweeping.chunk import compute_chunk

ROOT = Path(workers.__path__[0]).parent
PACKAGE = "workers.solvers.compiled"
PROBLEM = {
    "body": {"A": "2", "C": "1"},
    "potential": {"type": "expression", "expression": "-g1"},
    "motion": {"type": "planar", "lambda": "1"},
    "time": {"stop": "1", "samples": 2},
    "accuracy": {"tier": "draft"},
}
CALLING = """
import sys
from workers.computation import compiled_code
from workers.solvers.compiled.kernels import Kernel
from workers.solvers.ways import NotReadyError
when, may_compile = sys.argv[1:]
if may_compile == "yes":
    compiled_code.allow_compiling()
if when == "before":
    compiled_code.keep_compiled_code()
from workers.solvers.compiled.evaluation.interpreter import power
if when == "after":
    compiled_code.keep_compiled_code()
try:
    assert power(3.0, 2.0) == 9.0
except NotReadyError as fault:
    print(fault)
else:
    print(sum(power.stats.cache_hits.values()), sum(power.stats.cache_misses.values()))
"""
STAMPS = """
import json, sys
from workers.computation.compiled_code import stamp
print(json.dumps({name: stamp(name) for name in sys.argv[1:]}))
"""


def modules():
    return [found.name for found in pkgutil.walk_packages(compiled.__path__, PACKAGE + ".")]


def run(code, *arguments, folder, root=ROOT):
    result = subprocess.run(
        [sys.executable, "-P", "-c", code, *arguments],
        env={**os.environ, FOLDER_VARIABLE: str(folder), "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=True,
    )
    return result.stdout.strip()


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """Our sources in another folder, with other times of change."""
    folder = tmp_path_factory.mktemp("clone")
    for name in ("service", "workers"):
        shutil.copytree(
            ROOT / name,
            folder / name,
            copy_function=shutil.copyfile,
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    return folder


def hits_after_solving(document):
    """Return how often the solver of a fresh child was found compiled; called in that child."""
    assert isinstance(solve_document(document), Solved)
    from workers.solvers.compiled.solve_set import solve_sets  # noqa: PLC0415

    return sum(solve_sets.stats.cache_hits.values())


@pytest.mark.one_in(2)
@each_once(first=["before", "after"], second=["after", "before"])
def test_a_second_process_finds_what_the_first_has_compiled(tmp_path, first, second):
    assert run(CALLING, first, "yes", folder=tmp_path) == "0 1"
    assert list(tmp_path.rglob("*power*"))
    assert run(CALLING, second, "no", folder=tmp_path) == "1 0"


@pytest.mark.long
def test_a_second_clone_finds_what_the_first_has_compiled(tmp_path, clone):
    assert run(CALLING, "before", "yes", folder=tmp_path) == "0 1"
    assert run(CALLING, "before", "no", folder=tmp_path, root=clone) == "1 0"


def test_what_is_not_there_is_not_compiled_by_the_way(tmp_path):
    said = run(CALLING, "before", "no", folder=tmp_path)
    assert said.startswith("workers.solvers.compiled.evaluation.interpreter.power is not compiled")
    assert not list(tmp_path.rglob("*.nbc"))


def test_what_a_package_ships_is_taken_and_said_to_be_complete_last(tmp_path, monkeypatch):
    package, own, copies = tmp_path / "polhode_compiled", tmp_path / "own", iter([shutil.copyfile])
    assert run(CALLING, "before", "yes", folder=package) == "0 1"
    (package / "compiled" / "ready-planar-1").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv(FOLDER_VARIABLE, str(own))
    with monkeypatch.context() as interrupted:
        interrupted.setattr(shutil, "copyfile", lambda *each: next(copies)(*each))
        with pytest.raises(StopIteration):
            take_shipped_code()
    assert len(list(own.rglob("*.nb[ci]"))) == 1
    assert not list(own.rglob("ready-*"))
    take_shipped_code()
    assert list(own.rglob("ready-*"))
    # Also when the package is gone.
    assert run(CALLING, "before", "no", folder=own) == "1 0"


def test_nothing_is_kept_where_nobody_asks_for_it(tmp_path):
    # Not even in the folder that the compiler itself would take from the environment.
    assert run(CALLING, "never", "yes", folder=tmp_path) == "0 1"
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


def imported_by(module):
    tree = ast.parse(Path(importlib.import_module(module).__file__).read_text(encoding="utf-8"))
    # Of the module only: what functions import is loaded by Python, and no kernel.
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module.startswith(PACKAGE):
            is_package = hasattr(importlib.import_module(node.module), "__path__")
            for alias in node.names:
                yield f"{node.module}.{alias.name}" if is_package else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.startswith(PACKAGE))


@pytest.mark.parametrize("module", modules())
def test_all_sources_that_a_kernel_reaches_are_part_of_its_address(module):
    """The test reads the tree of the sources; the product looks for lines that begin with an import."""
    assert set(imported_by(module)) - {module} <= reached(module)


@pytest.mark.parametrize("module", modules())
def test_all_functions_that_kernels_are_made_of_are_part_of_their_address(module):
    """Some are made by functions of other modules, even of one beside the package."""
    sources = {importlib.import_module(name).__file__ for name in reached(module)}
    kernels = [each for each in vars(importlib.import_module(module)).values() if isinstance(each, Kernel)]
    for each in kernels:
        if each.py_func.__module__ == module:
            assert each.py_func.__code__.co_filename in sources


def test_a_change_of_one_module_changes_the_address_of_what_depends_on_it_only(tmp_path, clone):
    changed = f"{PACKAGE}.general.steps"
    names = modules()
    before = json.loads(run(STAMPS, *names, folder=tmp_path, root=clone))
    assert before == {name: stamp(name) for name in names}
    source = clone / (changed.replace(".", "/") + ".py")
    text = source.read_bytes()
    source.write_bytes(text + b"\n# Another line.\n")
    try:
        after = json.loads(run(STAMPS, *names, folder=tmp_path, root=clone))
    finally:
        source.write_bytes(text)
    others = {name for name in names if before[name] != after[name]}
    assert others == {name for name in names if changed in reached(name)}
    assert changed in others
    assert f"{PACKAGE}.solve_set" not in others


def test_a_frozen_value_is_part_of_the_address(monkeypatch):
    module = importlib.import_module(f"{PACKAGE}.residual.nodes")
    # It comes from a module that has no kernels, whose source is no part of the address.
    assert "DEFAULT_INTERVALS" in vars(module)
    before = stamp.__wrapped__(module.__name__)
    monkeypatch.setattr(module, "DEFAULT_INTERVALS", module.DEFAULT_INTERVALS + 1)
    assert stamp.__wrapped__(module.__name__) != before


def test_the_folder_is_made_for_us_alone(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "new"))
    folder = own_folder()
    assert folder.parent == tmp_path / "new"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert own_folder() == folder


@pytest.mark.parametrize("mode", [0o770, 0o702])
def test_a_folder_that_others_may_write_to_is_not_taken_and_told(tmp_path, monkeypatch, mode):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    own_folder().chmod(mode)
    assert own_folder() is None
    assert f"set {FOLDER_VARIABLE} to a folder of your own, or chmod 700" in why_no_folder()


def test_without_a_folder_there_is_none_and_jobs_go_the_plain_way(tmp_path, monkeypatch):
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setenv(FOLDER_VARIABLE, str(file))
    monkeypatch.delenv(compiled_code.WAY_VARIABLE)
    monkeypatch.setattr(compiled_code, "_ready", set())
    assert own_folder() is None
    assert "cannot be made" in why_no_folder()
    assert way_for("planar") == "plain"
    outcome = solve_document(json.dumps(PROBLEM))
    assert outcome.summary["provenance"]["way"] == "plain"


def test_what_is_wrong_with_a_problem_is_final_while_kernels_are_not_ready(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.delenv(compiled_code.WAY_VARIABLE)
    monkeypatch.setattr(compiled_code, "_ready", set())
    outcome = solve_document(json.dumps({**PROBLEM, "motion": {**PROBLEM["motion"], "window": 7}}))
    assert outcome.error["code"] == "no_such_window"


def test_a_refusal_of_the_plain_way_is_not_final_while_kernels_may_still_come(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.delenv(compiled_code.WAY_VARIABLE)
    monkeypatch.setattr(compiled_code, "_ready", set())
    state = {"type": "state", "gamma": ["0.6", "0", "0.8"], "omega": ["0", "1", "0.1"]}
    problem = {**PROBLEM, "body": {"A": 2, "B": "3/2", "C": 1}, "motion": state, "accuracy": {"tier": "high"}}
    with pytest.raises(NeedsKernelsError):
        solve_document(json.dumps(problem))
    # Nor is that of a point: its sweep waits.
    axes = [{"pointer": "/motion/omega/0", "values": [0, "1/10"]}]
    sweep = {"base": problem, "axes": axes, "keep": ["energy"]}
    chunk = {"sweep": sweep, "way": "plain", "first": 0, "count": 2}
    with pytest.raises(NeedsKernelsError) as waiting:
        compute_chunk(json.dumps({**chunk, "waits": True}))
    assert waiting.value.refusal["code"] == "accuracy_not_met"
    # Where somebody wants it so, it is.
    assert solve_document(json.dumps(problem), way="plain").error["code"] == "accuracy_not_met"
    assert compute_chunk(json.dumps({**chunk, "waits": False})).refused == 2


def test_an_atlas_takes_no_refusal_of_the_plain_way_for_final_either(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.delenv(compiled_code.WAY_VARIABLE)
    monkeypatch.setattr(compiled_code, "_ready", set())

    def refused(*_):
        raise AccuracyNotMetError(1.0, 1e-10)

    monkeypatch.setattr(compute, "_solve_in", refused)
    body = {"A": 2, "B": "3/2", "C": 1}
    asked = {"body": body, "potential": PROBLEM["potential"], "lambda": [0.5, 0.6], "samples": 9}
    document = json.dumps({**asked, "outputs": ["period", "stability"]})
    with pytest.raises(NeedsKernelsError):
        draw_document(document)
    atlas = json.loads(with_stability(document, examine_atlas_of_job(document)))["verdict"]
    windows = [window for part in atlas["parts"] for window in part["samples"]["windows"]]
    assert {reason for window in windows for reason in window["stability"]["reason"]} == {"accuracy_not_met"}


def test_the_folder_is_that_of_the_caches_where_none_is_named(tmp_path, monkeypatch):
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert own_folder().parent == tmp_path / "polhode"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert own_folder().parent == tmp_path / ".cache" / "polhode"


def test_a_way_is_compiled_when_all_its_groups_are_noted(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.delenv(compiled_code.WAY_VARIABLE)
    monkeypatch.setattr(compiled_code, "_ready", set())
    for group in GROUPS:
        assert way_for(*GROUPS) == "plain"
        note_of(group).touch()
        assert way_for(group) == "compiled"
    assert way_for(*GROUPS) == "compiled"


def test_code_that_nothing_uses_is_removed_after_long(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    folder = own_folder()
    used, young, old = (folder / name for name in ("used-1", "young-1", "old-1"))
    former, note = tmp_path / "compiled-0123456789abcdef", folder / "ready-planar-1"
    for each in (used, young, old, former):
        each.mkdir()
        (each / "code.nbc").touch()
    note.touch()
    long_ago = time.time() - 1000.0
    for each in (used, old, former, note):
        os.utime(each, (long_ago, long_ago))
    trim([used], unused_seconds=500.0)
    assert {each.name for each in folder.iterdir()} == {"used-1", "young-1"}
    assert not former.exists()
