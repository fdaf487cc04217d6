"""``polhode doctor`` on real solutions: clean as they are, not clean once a number was changed."""

import json
import subprocess
import sys
from pathlib import Path
from random import Random

import numpy as np
import pytest
from sqlalchemy import text, update

from service.sandbox import Sandbox
from service.schemas.problem.problem import check_problem, problem_digest
from service.storage.codecs import packing as codec
from service.storage.codecs.packing import decode_dense, encode_dense
from service.storage.database.database import Database
from service.storage.inspection import blob_inspection
from service.storage.inspection.blob_inspection import check_blobs
from service.storage.jobs.job_store import JobStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow
from tests.support.api import PLANAR, STATE
from tests.support.commands import polhode
from tests.workers.chores import do_chunk
from workers.cli.doctor import COLLISIONS, check_windows, repeat_solutions
from workers.computation.audit import Sameness
from workers.computation.compute import solve_document

pytestmark = pytest.mark.any_database

POLHODE = Path(sys.executable).with_name("polhode")


def solve(jobs, document):
    job = jobs.submit(document, problem_digest(check_problem(document).canonical))
    claim = jobs.claim("worker", lease_seconds=60.0)
    outcome = solve_document(json.dumps(claim.payload))
    assert jobs.finish(claim, outcome)[0]
    return jobs.get(job.id).solution_id


@pytest.fixture
def solved(jobs):
    return {"state": solve(jobs, STATE), "planar": solve(jobs, PLANAR)}


@pytest.fixture(scope="module")
def sandbox():
    sandbox = Sandbox(1, preload=["workers.computation.compute"])
    yield sandbox
    sandbox.close()


@pytest.fixture
def repeated(database, sandbox):
    def repeat():
        found = repeat_solutions(database, sandbox, count=2, seconds=60.0, random=Random(1))
        return {repetition.solution: repetition for repetition in found}

    return repeat


def change(database, table, solution_id, **values):
    key = table.id if table is SolutionRow else table.solution_id
    with database.write() as session:
        session.execute(update(table).where(key == solution_id).values(**values))


def function_of(database, solution_id):
    with database.read() as session:
        return decode_dense(session.get(DenseOutputRow, solution_id).data)


def shifted(dense, by):
    coefficients = dense.coefficients.copy()
    coefficients[:, 0] += by
    return encode_dense(
        type(dense)(
            **{name: getattr(dense, name) for name in dense.__dataclass_fields__ if name != "coefficients"},
            coefficients=coefficients,
        )
    )


def test_what_was_computed_here_is_found_again_bit_by_bit(repeated, solved):
    again = repeated()
    assert set(again) == set(solved.values())
    assert {each.sameness for each in again.values()} == {Sameness.IDENTICAL}


def test_samples_that_were_removed_to_save_space_are_not_missed(database, solved, repeated):
    with database.write() as session:
        session.execute(text("DELETE FROM samples"))
    assert {each.sameness for each in repeated().values()} == {Sameness.IDENTICAL}


def summary_of(database, solution_id):
    with database.read() as session:
        return dict(session.get(SolutionRow, solution_id).summary)


def comes_from_elsewhere(database, solution_id, **changes):
    """Make a solution one that another processor, or another version, has stored."""
    summary = summary_of(database, solution_id)
    provenance = {k: v for k, v in (summary["provenance"] | changes).items() if v is not None}
    change(database, SolutionRow, solution_id, summary={**summary, "provenance": provenance})


ELSEWHERE = [
    {"processor": "x86_64 AVX2 BLAS:Haswell"},
    {"libraries": "numpy 1.0"},
    {"version": "0.0.1"},
    {"processor": None, "libraries": None},
]


@pytest.mark.parametrize("elsewhere", ELSEWHERE, ids=[" ".join(each) for each in ELSEWHERE])
def test_between_processors_other_bits_within_the_errors_are_told_and_beyond_them_refused(
    database, solved, repeated, elsewhere
):
    for each in solved.values():
        comes_from_elsewhere(database, each, **elsewhere)
    planar = function_of(database, solved["planar"])
    change(database, DenseOutputRow, solved["planar"], data=shifted(planar, planar.error))
    state = function_of(database, solved["state"])
    # Both errors together allow twice the one: ten times is beyond whatever the reading adds to them.
    change(database, DenseOutputRow, solved["state"], data=shifted(state, 10 * state.error))
    again = repeated()
    assert again[solved["planar"]].sameness is Sameness.WITHIN_ERRORS
    assert again[solved["planar"]].is_clean
    assert f"with another {', '.join(elsewhere)}" in again[solved["planar"]].detail
    assert again[solved["state"]].sameness is Sameness.DIFFERENT
    assert not again[solved["state"]].is_clean


def test_between_processors_errors_are_estimates(database, solved, repeated):
    """The same problem's error, the rest of a cancellation in doubles, differs in its digits elsewhere."""
    summary = summary_of(database, solved["planar"])
    energy = {**summary["energy"], "error": summary["energy"]["error"] * 1.001}
    change(database, SolutionRow, solved["planar"], summary={**summary, "energy": energy})
    comes_from_elsewhere(database, solved["planar"], processor="aarch64")
    assert repeated()[solved["planar"]].sameness is Sameness.WITHIN_ERRORS


def test_a_like_processor_finds_the_same_bits_or_one_of_the_two_is_wrong(database, solved, repeated):
    planar = function_of(database, solved["planar"])
    change(database, DenseOutputRow, solved["planar"], data=shifted(planar, planar.error))
    with database.write() as session:
        session.execute(text("DELETE FROM samples"))
    found = repeated()[solved["planar"]]
    assert (found.sameness, found.is_clean) == (Sameness.DIFFERENT, False)
    assert "like processor" in found.detail


def test_other_words_about_the_same_numbers_are_no_other_numbers(database, solved, repeated):
    summary = summary_of(database, solved["planar"])
    change(database, SolutionRow, solved["planar"], summary={**summary, "conventions": ["another"]})
    found = repeated()[solved["planar"]]
    assert (found.sameness, found.is_clean) == (Sameness.WITHIN_ERRORS, True)


def test_arrays_that_are_packed_otherwise_are_the_same_numbers(database, solved, repeated, monkeypatch):
    planar = function_of(database, solved["planar"])
    packed = encode_dense(planar)
    monkeypatch.setattr(codec, "_LEVEL", 19)
    monkeypatch.delattr(codec._OF_THREAD, "compressor")
    packed_otherwise = encode_dense(planar)
    assert packed_otherwise != packed
    change(database, DenseOutputRow, solved["planar"], data=packed_otherwise)
    assert repeated()[solved["planar"]].is_clean


def test_a_changed_period_is_refused(database, solved, repeated):
    summary = summary_of(database, solved["planar"])
    summary["period"] = {**summary["period"], "value": np.nextafter(summary["period"]["value"], 9.0) + 1e-9}
    change(database, SolutionRow, solved["planar"], summary=summary)
    assert repeated()[solved["planar"]].sameness is Sameness.DIFFERENT


def test_a_problem_that_cannot_be_solved_any_more_is_told(database, solved, repeated):
    change(
        database, SolutionRow, solved["planar"], problem={**PLANAR, "motion": {"type": "planar", "nu": -1}}
    )
    again = repeated()[solved["planar"]]
    assert (again.sameness, again.is_clean) == (Sameness.FAILED, False)


@pytest.fixture
def chunks(jobs, database):
    sweep = SweepStore(database).submit({"seconds": 0.01}, points=40, most=16)
    while (claim := jobs.claim("worker", lease_seconds=60.0)) is not None:
        jobs.finish(claim, do_chunk(json.dumps(claim.payload)))[0]
    return sweep.id


def unreadable(database, sample=None):
    return {
        finding.code: finding.broken
        for finding in check_blobs(database, sample=sample, random=Random(1))
        if finding.broken
    }


def test_every_packet_is_read_and_the_damaged_ones_are_found(database, solved, chunks, monkeypatch):
    # Several pages even of so few.
    monkeypatch.setattr(blob_inspection, "_PAGE", 1)
    assert unreadable(database) == {}
    change(database, DenseOutputRow, solved["state"], data=b"damaged")
    change(database, SamplesRow, solved["planar"], data=b"PLH1")
    with database.write() as session:
        session.execute(text("UPDATE sweep_chunks SET refused = refused + 1"))
        stored = session.execute(text("SELECT count(*) FROM sweep_chunks")).scalar_one()
    assert unreadable(database) == {"dense_packets": 1, "samples_packets": 1, "chunk_packets": stored}


def test_bounds_that_do_not_hold_are_found(database, chunks):
    with database.write() as session:
        session.execute(text("""UPDATE sweep_chunks SET bounds = '{"period": [0, 1]}'"""))
    assert unreadable(database)["chunk_packets"] > 1


def test_a_sample_reads_so_many_and_no_more(database, chunks):
    with database.write() as session:
        session.execute(text("UPDATE sweep_chunks SET refused = refused + 1"))
    assert unreadable(database, sample=2) == {"chunk_packets": 2}


@pytest.fixture
def doctor(sqlite_url, monkeypatch, capsys):
    monkeypatch.setenv("POLHODE_DATABASE_URL", sqlite_url)

    def run(*options):
        code = polhode("doctor", "--sample", "0", *options)
        return code, capsys.readouterr().out

    return run


def test_the_command_says_what_is_wrong_and_mends_it(doctor, sqlite_url):
    assert doctor()[0] == 0
    database = Database(sqlite_url)
    JobStore(database).submit(STATE, "digest")
    with database.write() as session:
        session.execute(text("UPDATE jobs SET finished_at = 1"))
    database.close()
    code, said = doctor()
    assert code == 1
    assert "BROKEN   finished_at" in said
    assert "--fix" in said
    code, said = doctor("--fix", "--json")
    report = json.loads(said)
    assert (code, report["clean"]) == (0, True)
    assert [(law["code"], law["mended"]) for law in report["mended"]] == [("finished_at", 1)]
    assert doctor() == (0, doctor()[1])


def test_a_database_that_cannot_be_read_is_a_failure_with_a_reason(doctor, monkeypatch, capsys):
    monkeypatch.setenv("POLHODE_DATABASE_URL", "sqlite:////missing/folder/x.db")
    assert polhode("doctor") == 1
    said = "the database cannot be checked: the file of the database cannot be opened"
    assert capsys.readouterr().err.startswith(said)


def test_the_command_line_hands_over_to_the_worker(sqlite_url):
    command = [
        POLHODE,
        "doctor",
        "--json",
        "--all",
        "--sample",
        "0",
        "--seed",
        "7",
        "--database-url",
        sqlite_url,
    ]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (result.returncode, result.stderr) == (0, "")
    assert json.loads(result.stdout)["clean"]


def beside_a_pole(window, **motion):
    expression = "-g1-(2*g1^2+g3^2)/20/(1/2-g2)"
    start = {"at": "equator", "s_sign": -1} if window else {"at": "rest"}
    return {
        **PLANAR,
        "body": {"A": 2, "C": 1},
        "potential": {"type": "expression", "expression": expression},
        "motion": {"type": "planar", "lambda": 1, "window": window, "start": start, **motion},
        "time": {"times": [0, "1/10"]},
    }


@pytest.mark.parametrize(("window", "count"), [(0, 0), (1, 1)])
def test_solutions_of_earlier_versions_beside_an_infinite_p_squared_are_listed(jobs, database, window, count):
    """The window that ends at g2 = 1/2, where p² is infinite, and not the one that turns back before it."""
    solution = solve(jobs, beside_a_pole(window))

    def numerics(value):
        with database.write() as session:
            row = session.get(SolutionRow, solution)
            row.summary = {**row.summary, "provenance": {**row.summary["provenance"], "numerics": value}}

    numerics(COLLISIONS)
    assert check_windows(database).broken == 0
    numerics(COLLISIONS - 1)
    found = check_windows(database)
    assert (found.broken, found.is_warning, found.is_clean) == (count, True, True)
    assert [example.partition(":")[0] for example in found.examples] == [solution] * count
