"""``polhode sweep`` as its users meet it."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pyarrow import csv, ipc, parquet

from service.schemas.sweep.reading import read_sweep
from tests.support.commands import polhode
from tests.support.waiting import PATIENCE, wait_until
from workers.computation.compute import solve_document

POLHODE = Path(sys.executable).with_name("polhode")
EXAMPLE = Path(__file__).parents[3] / "examples" / "sweep.json"
LAMBDA = "/motion/lambda"


def sweep(**fields):
    """A sweep that needs no compiler; its second point is no problem."""
    return {
        "base": {
            "body": {"A": 2, "C": 1},
            "potential": {"type": "gravity", "a": -1},
            "motion": {"type": "planar", "lambda": 1},
            "time": {"stop": 1, "samples": 3},
        },
        "axes": [{"pointer": LAMBDA, "values": ["1/2", -1, 1, "3/2"]}],
        "keep": ["period"],
        "series": True,
        **fields,
    }


@pytest.fixture
def file(tmp_path):
    def write(document: object) -> Path:
        path = tmp_path / "sweep.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        return path

    return write


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """The command within this process: its exit code, what it answers, what it says."""
    monkeypatch.chdir(tmp_path)

    def command(*arguments: object) -> tuple[int, str, str]:
        code = polhode("sweep", *arguments)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return command


READERS = {
    ".parquet": lambda path: parquet.read_table(path),
    ".arrow": lambda path: ipc.open_file(path).read_all(),
    ".csv": lambda path: csv.read_csv(path),
}


@pytest.mark.parametrize("suffix", READERS)
def test_every_point_is_in_the_file_with_the_numbers_of_its_job(run, file, tmp_path, suffix):
    document = sweep(series=suffix != ".csv")
    code, said, _ = run(file(document), "--out", tmp_path / f"points{suffix}", "--workers", 1)
    assert code == 0
    assert "4 of 4 points" in said
    assert "3  solved" in said
    assert "1  invalid_problem" in said
    table = READERS[suffix](tmp_path / f"points{suffix}").to_pydict()
    assert table["index"] == [0, 1, 2, 3]
    assert table[LAMBDA] == [0.5, -1.0, 1.0, 1.5]
    assert table["outcome"] == ["solved", "invalid_problem", "solved", "solved"]
    assert table["period"][1] is None
    for index in (0, 2, 3):
        outcome = solve_document(json.dumps(read_sweep(document).document(index)))
        assert table["period"][index] == outcome.summary["period"]["value"]
    if suffix != ".csv":
        assert table["t"] == [[0.0, 0.5, 1.0], None, *[[0.0, 0.5, 1.0]] * 2]


def test_the_summary_can_be_had_as_json(run, file):
    code, said, complaint = run(file(sweep()), "--json", "--workers", 1)
    assert (code, complaint) == (0, "")
    summary = json.loads(said)
    assert (summary["points"], summary["done"], summary["refused"]) == (4, 4, 1)
    assert summary["outcomes"] == {"solved": 3, "invalid_problem": 1}
    low, high = summary["bounds"]["period"]
    assert low < high
    assert summary["out"] is None


@pytest.mark.parametrize(
    ("name", "series", "reason"),
    [
        ("points.txt", True, "accepted are .parquet, .arrow, .csv"),
        ("points", True, "accepted are .parquet, .arrow, .csv"),
        ("points.csv", True, ".csv has no series; .parquet, .arrow have"),
    ],
)
def test_a_file_that_cannot_hold_the_points_is_wrong_usage(run, file, tmp_path, name, series, reason):
    code, said, complaint = run(file(sweep(series=series)), "--out", tmp_path / name)
    assert (code, said) == (2, "")
    assert reason in complaint
    assert not (tmp_path / name).exists()


def test_every_fault_of_a_sweep_is_a_line(run, file):
    axes = [{"pointer": "/motion/mu", "values": [1]}, {"pointer": LAMBDA, "linspace": [0, 1, 0]}]
    code, said, complaint = run(file(sweep(axes=axes)))
    assert (code, said) == (1, "")
    assert [line.partition(":")[0] for line in complaint.splitlines()] == [
        "/axes/1/linspace/2",
        "/axes/0/pointer",
    ]


@pytest.mark.parametrize(("content", "reason"), [("{", "line 1"), (None, "No such file")])
def test_a_file_that_cannot_be_read_is_refused(run, tmp_path, content, reason):
    path = tmp_path / "sweep.json"
    if content is not None:
        path.write_text(content, encoding="utf-8")
    code, said, complaint = run(path)
    assert (code, said) == (1, "")
    assert reason in complaint


def test_a_file_that_cannot_be_written_is_refused(run, file, tmp_path):
    code, said, complaint = run(file(sweep()), "--out", tmp_path / "missing" / "points.parquet")
    assert (code, said) == (1, "")
    assert "No such file" in complaint


def test_ctrl_c_leaves_a_valid_file_and_says_what_is_missing(file, tmp_path):
    endless = sweep(axes=[{"pointer": LAMBDA, "linspace": ["1/2", 2, 1_000_000]}], series=False)
    out = tmp_path / "points.parquet"
    environment = {name: value for name, value in os.environ.items() if not name.startswith("POLHODE_")}
    process = subprocess.Popen(
        [POLHODE, "sweep", file(endless), "--out", out, "--workers", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=tmp_path,
        start_new_session=True,
    )
    try:
        # The pilot of 16 points, and more.
        wait_until(lambda: out.exists() and out.stat().st_size > 1000, 60.0)
        # As a terminal does it: to every process of the group.
        os.killpg(process.pid, signal.SIGINT)
        said, complaint = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 1
    table = parquet.read_table(out)
    indices = table.column("index").to_numpy()
    assert np.array_equal(indices, np.unique(indices))
    assert f"{len(indices):,} of 1,000,000 points" in said
    assert f"stopped: {1_000_000 - len(indices):,} of 1,000,000 points are missing" in complaint
    assert "to 999999" in complaint
    assert "Traceback" not in complaint


def test_the_example_is_a_sweep():
    assert read_sweep(json.loads(EXAMPLE.read_text(encoding="utf-8"))).points == 8000
