"""The command line as its users meet it: a process with two streams and an exit code."""

import contextlib
import io
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pytest
from typer.testing import CliRunner

from service.cli.commands import app, run
from service.schemas.replies.installation import AccuracyTableModel
from service.storage.database.database import Database
from service.storage.solutions.accuracy_store import AccuracyStore
from tests.support.effort import seldom
from tests.support.waiting import is_alive, wait_until
from workers.cli.documents import solve_file

POLHODE = Path(sys.executable).with_name("polhode")
EXAMPLES = Path(__file__).parents[2] / "examples"
QUESTION = {"body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": -1}}


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("POLHODE_")}
    kept["POLHODE_LOG_FORMAT"] = "text"  # else the service announces itself in JSON where nobody looks
    return {**kept, "POLHODE_DATABASE_URL": f"sqlite:///{tmp_path / 'test.db'}"}


@pytest.fixture
def polhode(environment, tmp_path, monkeypatch):
    """Run a command in this process, with the streams and the exit code of one of its own."""

    def run_here(*arguments: object) -> "subprocess.CompletedProcess[str]":
        command = ["polhode", *map(str, arguments)]
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", command)
        output, complaints, code = io.StringIO(), io.StringIO(), 0
        with (
            mock.patch.dict(os.environ, environment, clear=True),
            contextlib.redirect_stdout(output),
            contextlib.redirect_stderr(complaints),
        ):
            try:
                run()
            except SystemExit as end:
                code = end.code
        return subprocess.CompletedProcess(command, code, output.getvalue(), complaints.getvalue())

    return run_here


@pytest.fixture
def process(environment, tmp_path):
    """Run a command as a process."""

    def run_there(*arguments: object) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [POLHODE, *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=120,
            env=environment,
            cwd=tmp_path,
            check=False,
        )

    return run_there


@pytest.fixture
def file(tmp_path):
    def write(document: object) -> Path:
        path = tmp_path / "document.json"
        path.write_text(document if isinstance(document, str) else json.dumps(document), encoding="utf-8")
        return path

    return write


def test_an_admissible_potential_is_described(process):
    result = process("validate", EXAMPLES / "bobylev-steklov.json")
    assert (result.returncode, result.stderr) == (0, "")
    assert "admissible" in result.stdout
    # h = -a nu/2 with a = -1.
    assert "h = 1/2*nu" in result.stdout
    # The window ends at the equator, where 1 - x² - x = 0.
    assert "0.61803398875" in result.stdout


def test_a_verdict_can_be_had_as_json(polhode, file):
    result = polhode("validate", "--json", file(QUESTION))
    assert result.returncode == 0
    verdict = json.loads(result.stdout)
    assert (verdict["verdict"], verdict["proof"], verdict["motions"]) == ("admissible", "symbolic", None)


def test_formulas_can_be_had_as_latex(polhode, file):
    result = polhode("validate", file(QUESTION), "--formulas", "latex")
    assert (result.returncode, result.stderr) == (0, "")
    assert r"latex       h \left(\nu\right) = " in result.stdout
    found = polhode("validate", "--json", file(QUESTION), "--formulas", "text,mathml")
    (potential,) = [
        row for row in json.loads(found.stdout)["formulas"] if row["name"] == "V" and not row["named"]
    ]
    assert potential["formats"]["text"] in ("V = -g1", "V = -1*g1")
    assert potential["formats"]["latex"] is None
    result = polhode("validate", file(QUESTION), "--formulas", "tex")
    assert (result.returncode, result.stdout) == (2, "")
    assert "'tex' is not accepted; accepted are text, latex, mathml" in result.stderr


def test_an_inadmissible_potential_is_a_refusal_with_its_counterexample(polhode):
    result = polhode("validate", EXAMPLES / "printed-a3.json")
    assert result.returncode == 1
    assert "residual" in result.stdout
    assert "inadmissible" in result.stderr


def test_a_problem_that_cannot_be_solved_is_refused(polhode, file):
    document = json.loads((EXAMPLES / "bobylev-steklov.json").read_text(encoding="utf-8"))
    # s² = -a/(2 C³ g1) > 0 needs sign(g1) = -sign(a), and nu < 0 makes g1 < 0.
    result = polhode("validate", file({**document, "motion": {"type": "planar", "nu": -1}}))
    assert result.returncode == 1
    assert result.stderr.startswith("no_motion: ")


FLAT = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {
        "type": "expression",
        "expression": "-(2*g1^2+g3^2)*exp(-w/(g2-1/3)^2)*(g2+1/2)",
        "parameters": {"w": 1},
    },
    "motion": {"type": "planar", "lambda": 1, "window": 1},
    "time": {"stop": 1, "samples": 3},
}
"""Between a rest point and the zero of exp(-1/x²)."""


def test_a_flat_zero_is_refused_by_name_and_followed_by_integration(process, file, capsys):
    result = process("solve", file(FLAT))
    assert result.returncode == 1
    assert result.stderr.startswith("flat_zero: p² vanishes at g2 = 0.333333333333")
    # The others in this process: what a process does with an error is seen above.
    for outputs in (["period"], ["gamma", "omega"]):
        assert solve_file(file({**FLAT, "outputs": outputs}), csv=None, as_json=False) == 1
        assert capsys.readouterr().err.startswith("flat_zero: ")
    assert solve_file(file({**FLAT, "method": "integration"}), csv=None, as_json=False) == 0
    assert "integration" in capsys.readouterr().out


def test_every_fault_of_a_file_is_a_line(polhode, file):
    result = polhode("validate", file({"body": {"A": 0, "C": "x"}, "potential": {"type": "none"}}))
    assert (result.returncode, result.stdout) == (1, "")
    assert [line.partition(":")[0] for line in result.stderr.splitlines()] == [
        "/body/A",
        "/body/C",
        "/potential/type",
    ]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("{", "line 1, column 2"),
        ('{"body": NaN}', "NaN"),
        ('{"body": 1, "body": 2}', "'body' is given twice"),
    ],
)
def test_what_is_not_json_is_refused(polhode, file, content, reason):
    result = polhode("validate", file(content))
    assert result.returncode == 1
    assert reason in result.stderr


def test_a_missing_file_is_refused(polhode):
    result = polhode("validate", "missing.json")
    assert (result.returncode, result.stderr) == (1, "missing.json: No such file or directory\n")


@pytest.mark.parametrize(
    "arguments",
    [
        ["validate"],
        ["nonsense"],
        ["serve", "--port", "99999"],
        ["serve", "--workers", "-1"],
        ["serve", "--log-level", "loud"],
        ["worker", "--slots", "0"],
        ["calibrate", "--slow"],
    ],
)
def test_wrong_usage_ends_with_2(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert result.stderr != ""
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "example.org"])
def test_other_machines_are_not_served(host, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["serve", "--host", host])
    assert result.exit_code == 2
    assert "127.0.0.1" in result.stderr


def test_migrate_makes_the_database_and_may_be_repeated(polhode, tmp_path):
    for _ in range(2):
        result = polhode("migrate")
        assert (result.returncode, result.stderr) == (0, "")
    assert (tmp_path / "test.db").exists()


@pytest.mark.parametrize(
    ("url", "code", "reason"),
    [
        ("sqlite:////missing/folder/x.db", 1, "cannot migrate the database: "),
        ("nonsense", 2, "database_url: "),
    ],
)
def test_a_database_that_cannot_be_had_is_a_failure_with_a_reason(polhode, url, code, reason):
    result = polhode("migrate", "--database-url", url)
    assert result.returncode == code
    assert result.stderr.startswith(reason)
    assert len(result.stderr.splitlines()) == 1


def test_solve_writes_numbers_for_programs(process, tmp_path):
    result = process("solve", EXAMPLES / "bobylev-steklov.json", "--json", "--csv", "samples.csv")
    assert result.returncode == 0, result.stderr
    # T for a = -1, C = 1, lambda = 1 to 34 digits: 6.432310535121612579869958267408499; one ulp is 9e-16.
    assert json.loads(result.stdout)["period"]["value"] == pytest.approx(6.432310535121612579, abs=9e-16)
    lines = (tmp_path / "samples.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].split(",") == ["t", "p", "q", "r", "g1", "g2", "g3"]
    assert len(lines) == 202


def test_solve_says_why_not(reason_of_solve):
    assert reason_of_solve.startswith("inadmissible_potential: ")


ENDLESS = {
    **QUESTION,
    "potential": {"type": "expression", "expression": "(2*g1^2+g3^2)*sin(1/(1-g2^2))"},
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 1, "samples": 2},
}
"""Without end many windows next to the pole."""


def test_windows_without_end_are_refused_by_name(polhode, file, capsys):
    result = polhode("validate", file(ENDLESS))
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr.startswith("essential_singularity: ")
    assert solve_file(file(ENDLESS), csv=None, as_json=False) == 1
    told = capsys.readouterr()
    assert (told.out, told.err.partition(":")[0]) == ("", "essential_singularity")


def test_solve_keeps_the_limit_of_a_verdict(process, file, environment):
    environment["POLHODE_VERDICT_SECONDS"] = "0.001"
    result = process("solve", file(ENDLESS))
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr.startswith("verdict_time_limit: ")


@pytest.fixture
def reason_of_solve(process, file):
    document = json.loads((EXAMPLES / "bobylev-steklov.json").read_text(encoding="utf-8"))
    result = process("solve", file({**document, "potential": {"type": "gravity", "a": -1, "c": 1}}))
    assert (result.returncode, result.stdout) == (1, "")
    return result.stderr


@pytest.mark.long
def test_calibrate_measures_and_stores_what_the_service_then_serves(process, environment):
    result = process("calibrate", "--quick", "--json")
    assert (result.returncode, result.stderr) == (0, "")
    table = json.loads(result.stdout)
    assert table["source"] == "measured"
    assert table["rows"]
    store = Database(environment["POLHODE_DATABASE_URL"])
    assert AccuracyTableModel.of(AccuracyStore(store).current()).model_dump() == table
    store.close()


def test_calibrate_needs_its_database(process):
    result = process("calibrate", "--quick", "--database-url", "sqlite:////missing/folder/x.db")
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr.startswith("cannot migrate the database: ")


@pytest.fixture
def service(environment, tmp_path) -> Iterator["Service"]:
    running = Service(environment, tmp_path)
    try:
        yield running
    finally:
        running.process.kill()
        running.process.communicate()


class Service:
    """``polhode serve`` on a free port."""

    def __init__(self, environment: dict[str, str], folder: Path) -> None:
        self.process = subprocess.Popen(
            [POLHODE, "serve", "--port", "0"], stderr=subprocess.PIPE, text=True, env=environment, cwd=folder
        )
        assert self.process.stderr is not None
        # Workers start beside it, and may log before it serves.
        line = next(line for line in self.process.stderr if "http://" in line)
        self.address = line.split()[1].rstrip(",")

    def call(self, path: str, document: object = None, **headers: str) -> tuple[int, dict]:
        body = None if document is None else json.dumps(document).encode()
        sent = {"Content-Type": "application/json", **headers}
        request = urllib.request.Request(self.address + path, data=body, headers=sent)
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return answer.status, json.load(answer)
        except urllib.error.HTTPError as error:
            with error:
                return error.code, json.load(error)

    def solve(self) -> dict:
        problem = json.loads((EXAMPLES / "bobylev-steklov.json").read_text(encoding="utf-8"))
        problem["time"]["samples"] = 1 + time.monotonic_ns() % 1000  # never the same: nothing is reused
        return self.call("/v1/jobs", problem, Prefer="wait=50")[1]

    def worker(self) -> int:
        """Return the process id of the worker."""
        found = subprocess.run(
            ["ps", "-o", "pid=,args=", "--ppid", str(self.process.pid)],
            capture_output=True,
            text=True,
            check=True,
        )
        return next(int(line.split()[0]) for line in found.stdout.splitlines() if "workers run" in line)


@pytest.mark.parametrize("number", [signal.SIGTERM, *seldom(signal.SIGINT)])
def test_serve_solves_and_stops_in_order(service, number):
    assert service.solve()["state"] == "succeeded"
    worker = service.worker()
    service.process.send_signal(number)
    assert service.process.wait(120) == 0
    assert not is_alive(worker)


def test_a_worker_that_was_killed_is_replaced_and_none_outlives_a_service_that_was_killed(service):
    service.solve()
    killed = service.worker()
    os.kill(killed, signal.SIGKILL)
    assert service.solve()["state"] == "succeeded"
    worker = service.worker()
    assert worker != killed
    service.process.kill()
    service.process.wait()
    wait_until(lambda: not is_alive(worker))


def test_a_port_in_use_is_a_failure_with_a_reason(process):
    with socket.create_server(("127.0.0.1", 0)) as other:
        result = process("serve", "--port", other.getsockname()[1])
    assert result.returncode == 1
    assert "Address already in use" in result.stderr


def test_a_number_that_no_double_is_near_is_refused_by_every_command(tmp_path, capsys):
    path = tmp_path / "document.json"
    problem = {**QUESTION, "motion": {"type": "planar", "lambda": 1}, "time": {"stop": 1, "samples": 2}}
    path.write_text(json.dumps(problem).replace('"lambda": 1', '"lambda": 1e-400'), encoding="utf-8")
    result = CliRunner().invoke(app, ["validate", str(path)])
    assert (result.exit_code, result.stderr.partition(":")[0]) == (1, "/motion/lambda")
    assert solve_file(path, csv=None, as_json=False) == 1
    assert capsys.readouterr().err.partition(":")[0] == "/motion/lambda"
