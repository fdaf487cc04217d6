"""``polhode backup``, ``restore`` and ``prune``."""

import re

import pytest
from typer.testing import CliRunner

from service.cli.commands import app
from service.storage.database.database import Database
from service.storage.database.rows import new_id
from service.storage.jobs.job_store import JobStore
from tests.support.databases import PROBLEM, SUMMARY, url_of
from tests.support.finishing import finish_success


@pytest.fixture
def polhode(sqlite_url, monkeypatch):
    monkeypatch.setenv("POLHODE_DATABASE_URL", sqlite_url)
    monkeypatch.delenv("POLHODE_SAMPLES_DAYS", raising=False)

    def run(*arguments):
        result = CliRunner().invoke(app, [str(argument) for argument in arguments])
        assert result.stdout == ""
        return result.exit_code, result.stderr.strip()

    return run


@pytest.fixture
def solved(sqlite_url):
    database = Database(sqlite_url)
    jobs = JobStore(database)
    job = jobs.submit(PROBLEM, new_id())
    finish_success(jobs, jobs.claim("w", lease_seconds=60.0), SUMMARY, dense=b"d", samples=b"s" * 1_500_000)
    yield jobs.get(job.id)
    database.close()


def test_a_backup_says_what_is_in_it_and_comes_back(polhode, solved, tmp_path):
    file = tmp_path / "b"
    code, said = polhode("backup", file)
    assert code == 0
    assert re.fullmatch(rf"{re.escape(str(file))}: 1 jobs, 1 solutions, schema \d{{4}}, \d\.\d MB", said)
    code, said = polhode("backup", file)
    assert (code, said) == (1, f"no backup: {file} exists already; another name, or --force")
    assert polhode("backup", file, "--force")[0] == 0
    other = ["--database-url", url_of(tmp_path / "other.db")]
    assert polhode("restore", file, *other) == (0, "restored 1 jobs, 1 solutions")
    code, said = polhode("restore", file, *other)
    assert code == 1
    assert said.startswith("not restored: the database has 1 jobs")
    assert polhode("restore", file, *other, "--force")[0] == 0


def test_what_is_no_backup_is_a_reason_on_one_line(polhode, tmp_path):
    (tmp_path / "b").write_text("nonsense")
    code, said = polhode("restore", tmp_path / "b")
    assert (code, said) == (1, f"not restored: {tmp_path / 'b'}: file is not a database")


@pytest.mark.parametrize(("url", "exit_code"), [("nonsense", 2), ("sqlite:////missing/folder/x.db", 1)])
@pytest.mark.parametrize("command", ["backup", "restore"])
def test_a_database_that_cannot_be_had_is_a_reason(polhode, tmp_path, solved, command, url, exit_code):
    polhode("backup", tmp_path / "good")
    file = tmp_path / ("new" if command == "backup" else "good")
    code, said = polhode(command, file, "--database-url", url)
    assert code == exit_code
    assert len(said.splitlines()) == 1


def test_pruning_says_what_it_does(polhode, solved, monkeypatch):
    assert polhode("prune", "--samples-older-than", "1m") == (
        0, "samples of 0 solutions, 0.0 MB, and 0 kept examinations deleted",
    )  # fmt: skip
    monkeypatch.setenv("POLHODE_SAMPLES_DAYS", "0.00000001")  # a millisecond
    assert polhode("prune", "--dry-run") == (
        0,
        "samples of 1 solutions, 1.5 MB, and 0 kept examinations would be deleted",
    )
    assert polhode("prune") == (0, "samples of 1 solutions, 1.5 MB, and 0 kept examinations deleted")
    assert polhode("prune") == (0, "samples of 0 solutions, 0.0 MB, and 0 kept examinations deleted")


@pytest.mark.parametrize("arguments", [[], ["--samples-older-than", "soon"], ["--samples-older-than", "-1d"]])
def test_pruning_without_an_age_is_wrong_usage(polhode, arguments):
    assert polhode("prune", *arguments)[0] == 2
