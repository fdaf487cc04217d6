"""The commands that ask a service, as processes; and those that a service of this tree cannot answer yet."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import typer
from typer.testing import CliRunner, Result

from service.cli.commands import app
from service.cli.remote import work
from service.terminal import FileFaultError, read_items
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


def test_from_submitting_to_the_samples(remote, here, base, tmp_path):
    submitted = remote("submit", "-", content=json.dumps(base))
    assert (submitted.returncode, submitted.stderr) == (0, "")
    job = submitted.stdout.strip()
    waited = here("wait", job, "--json")
    solution = json.loads(waited.stdout)
    shown = here("show", solution["id"])
    period = solution["period"]
    assert f"{period['value']} ± {period['error']:.1e}" in shown.stdout
    assert json.loads(here("show", job, "--json").stdout)["solution"] == solution["id"]
    # Of a job or of its solution, by the ending or to stdout.
    csv = remote("get", job).stdout
    assert csv.splitlines()[0] == "t,p,q,r,g1,g2,g3"
    assert len(csv.splitlines()) == 12
    file = tmp_path / "samples.parquet"
    later = here("get", solution["id"], "--out", file, "--start", 64, "--stop", 80, "--samples", 5)
    assert later.exit_code == 0
    assert pq.read_table(file).column("t").to_pylist() == [64, 68, 72, 76, 80]


def test_a_sweep_by_a_service(remote, here, base, tmp_path):
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
    listed = json.loads(here("list", "points=5", "--of", "sweeps", "--json").stdout)
    assert sweep in {row["id"] for row in listed}
    again = remote("get", sweep, "--where", "index<2")
    assert len(again.stdout.splitlines()) == 3
    assert here("sweep", tmp_path / "sweep.json", "--remote", "--workers", 2).exit_code == 2


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


def test_a_list_goes_on_after_a_refusal_and_tells_every_place(here, base):
    problems = [base | {"motion": base["motion"] | {"lambda": f"{100 + k}/100"}} for k in range(5)]
    bad = base | {"body": {"A": -2, "C": 1}}
    content = "\n".join(json.dumps(each) for each in [*problems[:2], bad, *problems[2:]])
    listed = here("submit", "-", content=f"{content}\n{{broken\n")
    lines = [line.split("  ", 2) for line in listed.stdout.splitlines()]
    assert listed.exit_code == 1
    assert [int(line[0]) for line in lines] == list(range(7))
    assert [index for index, line in enumerate(lines) if line[1] == "-"] == [2, 6]
    assert "/body/A: -2 is not positive" in lines[2][2]
    assert "number 6: line 1, column 2" in lines[6][2]
    assert "2 of 7 problems were refused" in listed.stderr
    # The same list once more has the same jobs, also as a JSON list.
    again = here("submit", "-", content=json.dumps([*problems[:2], bad, *problems[2:]]))
    assert [line.split()[1] for line in again.stdout.splitlines()] == [line[1] for line in lines[:6]]


def test_a_list_is_waited_for(here, base):
    failing = base | {"body": {"A": 0, "C": 1}}
    done = here("submit", "-", "--wait", content=json.dumps([base, failing]))
    assert done.exit_code == 1
    first, second = sorted(done.stdout.splitlines())
    solution = first.split()[1]
    assert json.loads(here("show", solution, "--json").stdout)["id"] == solution
    assert second.startswith("1  -  ")


def test_a_list_of_any_length_is_read_item_by_item(tmp_path):
    def items(text):
        (tmp_path / "list").write_text(text)
        is_list, found = read_items(tmp_path / "list")
        return is_list, [str(each) if isinstance(each, FileFaultError) else each for each in found]

    many = [{"a": list(range(100))} for _ in range(2000)]
    assert items(json.dumps(many)) == items(json.dumps(many, indent=1)) == (True, many)
    assert items("\n".join(json.dumps(each) for each in many)) == (True, many)
    assert items(json.dumps(many[0], indent=1)) == items(json.dumps(many[0])) == (False, [many[0]])
    assert items("[]") == (True, [])
    # One that repeats a field is refused in its place, as the service would.
    is_list, found = items('[{"a": 1}, {"a": 1, "a": 2}, {"b": 1}]')
    assert (is_list, found[0], found[2]) == (True, {"a": 1}, {"b": 1})
    assert "number 1: " in found[1]
    assert "what follows is not read" in items('[{"a": 1} {"b": 1}]')[1][-1]
    assert "what follows is not read" in items('[{"a": 1}, {"b": ')[1][-1]


def test_a_list_for_people_tells_the_problem_and_fits_the_terminal(here, base, monkeypatch):
    done = here("submit", "-", "--wait", content=json.dumps(base))
    assert done.exit_code == 0
    head, line = here("list", "--limit", 1).stdout.splitlines()
    assert head.split()[:5] == ["id", "potential", "λ", "period", "energy"]
    assert str(base["potential"].get("expression", base["potential"]["type"])) in line
    solution = json.loads(here("show", line.split()[0], "--json").stdout)
    assert f"{solution['period']['value']:.6g}" in line
    assert repr(solution["period"]["value"]) not in line
    monkeypatch.setattr(work, "_width", lambda: 70)
    narrow = here("list", "--limit", 1).stdout.splitlines()
    assert max(map(len, narrow)) <= 70
    assert narrow[1].split()[0] == solution["id"]


@pytest.mark.parametrize("ending", ["csv", "parquet", "arrow", "ndjson"])
def test_a_list_is_written_to_a_file(here, base, tmp_path, ending):
    assert here("submit", "-", "--wait", content=json.dumps(base)).exit_code == 0
    out = tmp_path / f"solutions.{ending}"
    assert here("list", "--out", out, "--columns", "id,period,lambda").exit_code == 0
    count = len(json.loads(here("list", "--json", "--limit", 10_000).stdout))
    match ending:
        case "csv":
            rows = len(out.read_text().splitlines()) - 1
        case "ndjson":
            rows = len(out.read_text().splitlines())
        case "parquet":
            rows = pq.read_table(out).num_rows
        case _:
            rows = pa.ipc.open_stream(out).read_all().num_rows
    assert rows == count
    refused = here("list", "--out", tmp_path / "solutions.npz")
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert ".parquet" in refused.stderr


def test_a_report_has_the_problem_and_every_output(here, base):
    asked = base | {
        "body": {"A": 2, "B": "3/2", "C": 1},
        "outputs": ["gamma", "omega", "stability", "orientation"],
        "labels": {"project": "thesis"},
    }
    shown = here("submit", "-", "--wait", content=json.dumps(asked)).stdout
    words = [line.split()[0] for line in shown.splitlines()]
    assert {
        "id",
        "body",
        "potential",
        "motion",
        "times",
        "period",
        "range",
        "stability",
        "precession",
    } <= set(words)
    job = here("submit", "-", content=json.dumps(asked)).stdout.strip()
    report = here("show", job).stdout
    assert "project=thesis" in report
    assert report.splitlines()[1].split()[0] == "state"


def test_an_interrupted_sweep_goes_on_and_tells_how_to_get_it(capsys):
    with pytest.raises(KeyboardInterrupt), work.going_on(NO_ID):
        raise KeyboardInterrupt
    told = capsys.readouterr().err
    assert "goes on" in told
    for command in ("wait", "get", "cancel"):
        assert f"polhode {command} {NO_ID}" in told


def test_help_is_there_in_encodings_that_lack_its_letters():
    environment = {"PYTHONIOENCODING": "cp1252", "PATH": ""}
    shown = subprocess.run([POLHODE, "--help"], capture_output=True, env=environment, check=False)
    assert (shown.returncode, shown.stderr) == (0, b"")
    assert b"families" in shown.stdout


def test_a_verdict_of_a_service_is_that_of_this_machine(here, service, base):
    question = json.dumps({name: base[name] for name in ("body", "potential", "motion")})
    ours, theirs = (
        here("validate", "-", content=question),
        here("validate", "-", "--url", service.address, content=question),
    )
    assert (theirs.exit_code, theirs.stdout) == (ours.exit_code, ours.stdout) == (0, ours.stdout)
    assert "verdict     admissible" in theirs.stdout
    bad = json.dumps({"body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": 1, "b": 1}})
    refused = here("validate", "-", "--url", service.address, content=bad)
    assert refused.exit_code == 1
    assert "nearest" in refused.stdout


def test_the_nearest_polynomial_is_told_of_a_whole_problem_too(here, base):
    potential = {"type": "gravity", "a": 1, "b": 1}
    whole = here("validate", "-", content=json.dumps(base | {"potential": potential}))
    alone = here("validate", "-", content=json.dumps({"body": base["body"], "potential": potential}))
    assert whole.exit_code == alone.exit_code == 1
    (line,) = [each for each in alone.stdout.splitlines() if each.startswith("nearest")]
    assert line.partition(", least up to")[0] in whole.stderr
