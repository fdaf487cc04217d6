"""The commands that ask a service, as processes; and those that a service of this tree cannot answer yet."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import typer
from typer.testing import CliRunner, Result

from service.cli.commands import app
from tests.client.conftest import base, service

__all__ = ["base", "service"]

POLHODE = Path(sys.executable).with_name("polhode")
NO_ID = "01a2093c-94c9-70fd-9ade-9dd8a9a0e28b"


@pytest.fixture
def remote(service, tmp_path, monkeypatch):
    monkeypatch.setenv("POLHODE_URL", service.address)
    monkeypatch.setenv("POLHODE_CACHE", str(tmp_path / "cache"))

    def run(*arguments: object, content: str | None = None) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [POLHODE, *map(str, arguments)], capture_output=True, text=True, input=content, check=False
        )

    return run


@pytest.fixture
def here(remote):
    """The same in this process: what a mistake says needs no other one."""

    def run(*arguments: object, content: str | None = None) -> Result:
        return CliRunner().invoke(app, list(map(str, arguments)), input=content)

    return run


def test_from_submitting_to_the_samples(remote, base, tmp_path):
    submitted = remote("submit", "-", content=json.dumps(base))
    assert (submitted.returncode, submitted.stderr) == (0, "")
    job = submitted.stdout.strip()
    waited = remote("wait", job, "--json")
    solution = json.loads(waited.stdout)
    shown = remote("show", solution["id"])
    period = solution["period"]
    assert f"{period['value']} ± {period['error']:.1e}" in shown.stdout
    assert json.loads(remote("show", job, "--json").stdout)["solution"] == solution["id"]
    # Of a job or of its solution, by the ending or to stdout.
    csv = remote("get", job).stdout
    assert csv.splitlines()[0] == "t,p,q,r,g1,g2,g3"
    assert len(csv.splitlines()) == 12
    file = tmp_path / "samples.parquet"
    later = remote("get", solution["id"], "--out", file, "--start", 64, "--stop", 80, "--samples", 5)
    assert later.returncode == 0
    assert pq.read_table(file).column("t").to_pylist() == [64, 68, 72, 76, 80]


def test_a_sweep_by_a_service(remote, base, tmp_path):
    document = {
        "base": base,
        "axes": [{"pointer": "/motion/lambda", "linspace": [1, 2, 5]}],
        "keep": ["period"],
    }
    (tmp_path / "sweep.json").write_text(json.dumps(document))
    done = remote("sweep", tmp_path / "sweep.json", "--remote", "--out", "-")
    assert (done.returncode, len(done.stdout.splitlines())) == (0, 6)
    assert "\r" not in done.stderr  # no bar: nobody watches
    sweep = done.stderr.split()[1]
    listed = json.loads(remote("list", "points=5", "--of", "sweeps", "--json").stdout)
    assert sweep in {row["id"] for row in listed}
    again = remote("get", sweep, "--where", "index<2")
    assert len(again.stdout.splitlines()) == 3
    assert remote("sweep", tmp_path / "sweep.json", "--remote", "--workers", 2).returncode == 2


def test_lists_are_tables_for_people_and_json_for_programs(here, base):
    assert here("submit", "-", "--wait", content=json.dumps(base)).exit_code == 0
    asked = ("list", "period<50", "--columns", "id,period", "--limit", "3")
    head, *lines = here(*asked).stdout.splitlines()
    assert head.split() == ["id", "period"]
    rows = json.loads(here(*asked, "--json").stdout)
    assert [line.split() for line in lines] == [[row["id"], repr(row["period"])] for row in rows]
    nothing = here("list", "period<0")
    assert (nothing.stdout, nothing.stderr) == ("", "no solutions meet this\n")


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["list", "perod<5"], 1, "did you mean 'period'?"),
        (["show", NO_ID], 1, "no job, solution or sweep has the id"),
        (["cancel", NO_ID], 1, "no job, solution or sweep has the id"),
        (["submti"], 2, "'submit'"),
        (["list", "--ordr", "energy"], 2, "--order"),
        (["list", "--of", "sweps"], 2, "'sweeps'"),
        (["get", NO_ID, "--out", "samples.txt"], 2, ".parquet"),
        (["tag", NO_ID, "project"], 2, "NAME=VALUE"),
        (["tag", NO_ID], 2, "neither a label nor a note"),
        (["show", NO_ID, "--url", "localhost"], 2, "is no address"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_mistakes_are_told_with_what_is_accepted(here, arguments, code, told):
    result = here(*arguments)
    assert (result.exit_code, result.stdout) == (code, "")
    assert told in result.stderr


def test_a_refused_problem_tells_its_faults(here, base):
    result = here("submit", "-", content=json.dumps(base | {"body": {"A": -2, "C": 1}}))
    assert result.exit_code == 1
    assert "/body/A: -2 is not positive" in result.stderr
    finished = here("submit", "-", "--wait", "--json", content=json.dumps([base, base]))
    assert len(json.loads(finished.stdout)) == 2
    job = here("submit", "-", content=json.dumps(base)).stdout.strip()
    assert "succeeded" in here("cancel", job).stderr


def test_help_has_examples_and_shells_complete(remote, here, monkeypatch):
    for name, command in typer.main.get_command(app).commands.items():
        if not hasattr(command, "commands"):
            assert re.search(rf"\n    (\w+=\w+ )?polhode {name}\b", here(name, "--help").stdout), name
    monkeypatch.setenv("_POLHODE_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "polhode s")
    monkeypatch.setenv("COMP_CWORD", "1")
    assert set(remote().stdout.split()) >= {"submit", "show", "sweep", "solve", "serve"}


def test_labels_are_changed_and_listed(here, base):
    job = here("submit", "-", content=json.dumps(base | {"labels": {"project": "old", "run": "7"}}))
    thing = job.stdout.strip()
    assert here("wait", thing).exit_code == 0
    # A job and its solution have labels of their own.
    solution = json.loads(here("show", thing, "--json").stdout)["solution"]
    for each, of in ((thing, "jobs"), (solution, "solutions")):
        changed = here("tag", each, "project=remote", "run=", "figure=3", "--note", "checked", "--json")
        document = json.loads(changed.stdout)
        assert document["labels"] == {"project": "remote", "figure": "3"}
        assert document["note"] == "checked"
        listed = here("list", "label.project=remote", "--of", of)
        head, line = listed.stdout.splitlines()
        assert head.split()[-1] == "labels"
        assert "figure=3, project=remote" in line
        rows = json.loads(here("list", f"id={each}", "--of", of, "--columns", "labels", "--json").stdout)
        assert rows == [{"labels": document["labels"]}]
    refused = here("tag", thing, "=thesis")
    assert refused.exit_code == 2
