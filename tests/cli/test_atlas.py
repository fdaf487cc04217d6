"""``polhode atlas`` as its users meet it."""

import json
import subprocess
import sys
from pathlib import Path

from typer.testing import CliRunner

from workers.cli.main import app

POLHODE = Path(sys.executable).with_name("polhode")
ATLAS = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"},
    "lambda": ["1/2", 1],
    "samples": 9,
}


def run(tmp_path, *options, document=ATLAS):
    file = tmp_path / "atlas.json"
    file.write_text(json.dumps(document), encoding="utf-8")
    return CliRunner().invoke(app, ["atlas", str(file), *options])


def test_it_tells_for_which_lambda_there_is_a_motion(tmp_path):
    lines = run(tmp_path).stdout.splitlines()
    assert lines[0].startswith("λ from 0.5 to 0.58696474")
    assert lines[0].endswith("no motion")
    assert "a window appears" in lines[1]
    assert "periodic, rest to equator" in lines[3]


def test_json_and_a_picture(tmp_path):
    out = tmp_path / "atlas.svg"
    found = run(tmp_path, "--json", "--picture", str(out))
    assert found.exit_code == 0
    assert json.loads(found.stdout)["changes"][0]["kind"] == "window_appears"
    assert out.read_text(encoding="utf-8").startswith("<svg")
    # The standard output of a process, which the runner of tests does not have.
    command = [POLHODE, "atlas", str(tmp_path / "atlas.json"), "--picture", "-"]
    printed = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert printed.stdout == out.read_text(encoding="utf-8")


def test_stability_is_told_and_drawn(tmp_path):
    out = tmp_path / "atlas.svg"
    # The windows of one part only: each λ takes as long as a job.
    asked = {
        **ATLAS,
        "body": {**ATLAS["body"], "B": "3/2"},
        "lambda": ["3/5", "31/50"],
        "outputs": ["stability"],
    }
    found = run(tmp_path, "--picture", str(out), document=asked)
    assert found.exit_code == 0, found.stderr
    assert "stable at 9 of 9 λ" in found.stdout
    assert "μ + 1/μ" in out.read_text(encoding="utf-8")
    refused = run(tmp_path, document={**ATLAS, "outputs": ["stability"]})
    assert refused.exit_code == 1
    assert "missing_moment" in refused.stderr


def test_what_is_refused(tmp_path):
    assert run(tmp_path, "--json", "--picture", "-").exit_code == 2
    refused = run(tmp_path, document={**ATLAS, "lambda": [2, 1]})
    assert refused.exit_code == 1
    assert "/lambda/1" in refused.stderr
    unwritable = run(tmp_path, "--picture", str(tmp_path / "missing" / "x.svg"))
    assert unwritable.exit_code != 0
