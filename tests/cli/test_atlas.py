"""``polhode atlas`` as its users meet it."""

import io
import json
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from tests.support.commands import polhode

POLHODE = Path(sys.executable).with_name("polhode")
ATLAS = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"},
    "lambda": ["1/2", 1],
    "samples": 9,
}


@pytest.fixture
def atlas(tmp_path, capsys):
    """The command within this process: its exit code, what it answers, what it says."""

    def command(*options, document=ATLAS):
        file = tmp_path / "atlas.json"
        file.write_text(json.dumps(document), encoding="utf-8")
        return polhode("atlas", file, *options), *capsys.readouterr()

    return command


def test_it_tells_for_which_lambda_there_is_a_motion(atlas):
    lines = atlas()[1].splitlines()
    assert lines[0].startswith("λ from 0.5 to 0.58696474")
    assert lines[0].endswith("no motion")
    assert "a window appears" in lines[1]
    assert "periodic, turns at rest, crosses the equator" in lines[3]


def test_json_and_a_picture(atlas, tmp_path):
    out = tmp_path / "atlas.svg"
    code, answered, _ = atlas("--json", "--picture", out)
    assert code == 0
    assert json.loads(answered)["changes"][0]["kind"] == "window_appears"
    assert out.read_text(encoding="utf-8").startswith("<svg")
    # The standard output of a process, which tests do not have.
    command = [POLHODE, "atlas", str(tmp_path / "atlas.json"), "--picture", "-"]
    printed = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert printed.stdout == out.read_text(encoding="utf-8")


def test_stability_is_told_and_drawn(atlas, tmp_path):
    out = tmp_path / "atlas.svg"
    # The windows of one part only: each λ takes as long as a job.
    asked = {
        **ATLAS,
        "body": {**ATLAS["body"], "B": "3/2"},
        "lambda": ["3/5", "31/50"],
        "outputs": ["stability"],
    }
    code, answered, said = atlas("--picture", out, document=asked)
    assert code == 0, said
    assert "stable at 9 of 9 λ" in answered
    assert "μ + 1/μ" in out.read_text(encoding="utf-8")
    code, _, said = atlas(document={**ATLAS, "outputs": ["stability"]})
    assert code == 1
    assert "missing_moment" in said


def test_what_is_refused(atlas, tmp_path):
    assert atlas("--json", "--picture", "-")[0] == 2
    code, _, said = atlas(document={**ATLAS, "lambda": [2, 1]})
    assert code == 1
    assert "/lambda/1" in said
    assert atlas("--picture", tmp_path / "missing" / "x.svg")[0] == 1


def test_the_ending_names_the_kind_of_picture(atlas, tmp_path):
    assert atlas("--picture", tmp_path / "x.png")[0] == 0
    content = (tmp_path / "x.png").read_bytes()
    picture = matplotlib.image.imread(io.BytesIO(content), format="png")
    assert content.startswith(b"\x89PNG")
    assert picture.shape[1] == 2 * 860  # twice the width of the SVG
    # Something of every colour is there: the band of the window, and letters.
    band = np.abs(picture[..., :3] - np.array([0x3B, 0x6E, 0xA5]) / 255).max(axis=-1)
    assert (band < 0.02).any()
    assert (picture[..., :3].max(axis=-1) < 0.2).any()
    code, _, told = atlas("--picture", tmp_path / "x.jpg")
    assert code == 2
    assert ".svg, .png" in told
    assert not (tmp_path / "x.jpg").exists()
