"""The table of accuracy and speed is measured on what it says, and holds solutions to their claims."""

import json
import tempfile
from contextlib import nullcontext
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from rich.console import Console

from service.dynamics.accuracy import MOTION_KINDS, TIERS, Family
from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import NoClosedFormError
from service.dynamics.potentials.recognition import recognise
from service.schemas.problem.problem import read_problem
from service.schemas.query.terms import ListQuery
from service.schemas.replies.installation import AccuracyTableModel
from service.storage.codecs.packing import decode_arrays
from service.storage.database.database import Database
from service.storage.database.migration import migrate
from service.storage.solutions.accuracy_store import AccuracyStore
from service.storage.solutions.solution_store import SolutionStore
from tests.support.commands import polhode
from tests.support.databases import url_of
from workers.calibration import measurement
from workers.calibration.measurement import (
    CASES,
    FULL,
    QUICK,
    SAMPLES,
    STRIDE,
    ClaimExceededError,
    Effort,
    ReferenceStates,
    calibrate,
    reference_states,
    samples_of,
    steps,
    whole_jobs,
)
from workers.cli.calibrate import describe
from workers.computation.compute import solve_document

PENDULUM = CASES[0]
ONE = Effort((PENDULUM,), 1, 2000)


def kernel_seconds(document: str) -> float:
    """Measure the computation alone, which needs no other process."""
    return solve_document(document).summary["cost"]["compute_seconds"]


def test_a_whole_job_is_measured_and_not_only_its_computation(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    document = PENDULUM.document("draft", 3)
    with whole_jobs() as seconds_of:
        (folder,) = tmp_path.glob("polhode-calibration-*")
        database = Database(url_of(folder / "jobs.db"))
        # Nothing is reused: each is a job of its own, solved and stored.
        assert min(seconds_of(document) for _ in range(2)) > 0.0
        found = SolutionStore(database).find(ListQuery())
        cost = [solution.summary["cost"]["compute_seconds"] for solution in found.solutions]
        assert (found.total, all(each > 0.0 for each in cost)) == (2, True)
        database.close()
    assert not folder.exists()


@pytest.mark.one_in(3)
@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.kind}, {case.family}, {case.stop}")
def test_a_case_is_of_the_kind_and_family_it_is_filed_under(case):
    document = json.loads(case.document("standard", SAMPLES))
    document["time"] = {"times": [0]}
    summary = solve_document(json.dumps(document)).summary
    if case.kind == "any state":
        assert (summary["method"], summary["window"]) == ("integration", None)
    else:
        ends = " to ".join(summary["window"]["ends"])
        assert case.kind == ("aperiodic" if summary["aperiodic"] else ends)
    problem = read_problem(document)
    assert family_of(problem.body, problem.potential) == case.family


def family_of(body: RigidBody, potential) -> str:
    try:
        named = {instruction.name for instruction in potential.tape.instructions}
    except NoClosedFormError:
        return "integral"
    if "exp" in named:
        return "function"
    if body.A != 2 * body.C:
        return "general alpha"
    return "rational" if recognise(body, potential, 1) is None else "three-term"


def test_every_kind_and_family_is_measured():
    assert {case.kind for case in CASES} == set(MOTION_KINDS)
    assert {case.family for case in CASES} == set(get_args(Family))


def test_times_of_the_samples_are_doubles():
    # Else reference and solution would be taken at times half an ulp apart.
    for case in CASES:
        problem = read_problem(json.loads(case.document("standard", SAMPLES)))
        step = (problem.time.stop - problem.time.start) / (SAMPLES - 1)
        assert all(float(k * step) == k * step for k in range(0, SAMPLES, STRIDE))
    assert (SAMPLES - 1) % STRIDE == 0


def test_the_certified_reference_agrees_with_an_integration():
    certified = reference_states(PENDULUM)
    assert certified.source == "certified"
    # Balls of 128 bits, told as sums of two doubles: 2^-106 of numbers near 1.
    assert certified.error <= 2.0**-104
    outcome = solve_document(PENDULUM.reference_document())
    assert certified.departure(samples_of(decode_arrays(outcome.samples))) <= outcome.summary["error"]


def test_a_departure_is_seen_below_the_rounding_of_the_samples():
    high, low = np.full((1, 6), 0.5), np.zeros((1, 6))
    low[0, 3] = 3e-17
    reference = ReferenceStates("certified", high, low, 0.0)
    samples = np.full((1, 1, 6), 0.5)
    assert reference.departure(samples) == 3e-17
    samples[0, 0, 3] = np.nextafter(0.5, 1.0)  # one ulp, 2^-53
    assert reference.departure(samples) == 2.0**-53 - 3e-17
    further = np.stack([high, low])
    assert reference.departure(further) == 0.0


def test_a_table_has_a_row_or_a_reason_for_every_tier():
    told = []
    table = calibrate(ONE, kernel_seconds, step=told.append)
    assert len(told) == steps(ONE)
    found = [row.tier for row in table.rows] + [lack.tier for lack in table.unavailable]
    assert sorted(found) == sorted(TIERS)
    assert "standard" in {row.tier for row in table.rows}
    for row in table.rows:
        assert row.error <= row.claimed_error + row.reference_error
        assert row.seconds > 0
        assert row.seconds_per_1000 >= 0
    assert table.source == "measured"
    assert table.machine.cpus >= 1
    # People get a line for each of them.
    lines = describe(table).splitlines()
    assert [line.split()[0] for line in lines[3:]] == found


@pytest.fixture
def wrong_reference(monkeypatch):
    """Hold solutions against another potential's motion, which is far away."""
    other = reference_states(replace(PENDULUM, potential={"type": "gravity", "a": -2}))
    monkeypatch.setattr(measurement, "reference_states", lambda case: other)


def test_a_solution_beyond_its_claim_is_an_error(wrong_reference):
    with pytest.raises(ClaimExceededError, match="is claimed"):
        calibrate(ONE, kernel_seconds)


@pytest.fixture
def settled(tmp_path, monkeypatch):
    monkeypatch.setattr("workers.cli.calibrate.whole_jobs", lambda: nullcontext(kernel_seconds))
    url = url_of(tmp_path / "test.db")
    monkeypatch.setenv("POLHODE_DATABASE_URL", url)
    migrate(url)
    return url


def test_a_failed_calibration_stores_nothing(settled, wrong_reference, monkeypatch, capsys):
    monkeypatch.setattr("workers.cli.calibrate.QUICK", ONE)
    assert polhode("calibrate", "--quick") == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("nothing is stored: ")
    database = Database(settled)
    assert AccuracyStore(database).latest() is None
    database.close()


def test_nothing_is_measured_before_kernels_are_there(settled, monkeypatch):
    compiled = []
    monkeypatch.setattr("workers.cli.calibrate.way_for", lambda *_: "plain")
    monkeypatch.setattr("workers.cli.calibrate.compile_solvers", lambda: compiled.append(True) or 1)
    monkeypatch.setattr("workers.cli.calibrate.whole_jobs", None)
    assert polhode("calibrate", "--quick") == 1
    assert compiled == [True]


def test_what_was_measured_is_stored_and_printed_for_programs(settled, monkeypatch, capsys):
    monkeypatch.setattr("workers.cli.calibrate.QUICK", ONE)
    assert polhode("calibrate", "--quick", "--json") == 0
    table = json.loads(capsys.readouterr().out)
    assert (table["source"], bool(table["rows"])) == ("measured", True)
    database = Database(settled)
    assert AccuracyTableModel.of(AccuracyStore(database).current()).model_dump() == table
    database.close()


def test_a_quick_calibration_measures_less():
    """It solves less than a tenth: a tier of a problem is solved once, and per repetition twice."""
    quick, full = (len(effort.cases) * (1 + 2 * effort.repetitions) for effort in (QUICK, FULL))
    assert 10 * quick <= full
    assert all(case in FULL.cases for case in QUICK.cases)
    assert QUICK.many_samples < FULL.many_samples


def test_a_bar_is_drawn_for_people_only(settled, monkeypatch, capsys):
    monkeypatch.setattr("workers.cli.calibrate.QUICK", ONE)
    assert polhode("calibrate", "--quick") == 0
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(
        "workers.cli.calibrate.Console", lambda stderr: Console(stderr=stderr, force_terminal=True)
    )
    assert polhode("calibrate", "--quick") == 0
    assert "pole to equator" in capsys.readouterr().err


def test_the_processor_has_a_name_or_none():
    assert measurement.this_machine().model != ""
