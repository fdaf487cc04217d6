"""Atlases over HTTP: the document, its other formats, and what is refused."""

import csv
import io
import json
import xml.etree.ElementTree as ET

import pyarrow as pa
import pytest

from service.api.routes.atlases import EXAMPLES

pytestmark = pytest.mark.any_database

ARROW = "application/vnd.apache.arrow.stream"
ATLAS = {
    "body": {"A": 2, "C": 1},
    "potential": {
        "type": "expression",
        "expression": "a*g1 + b/g3^2 + c*(g1^2-g2^2)",
        "parameters": {"a": -1, "b": "1/20", "c": "3/2"},
    },
    "lambda": ["1/2", 3],
    "samples": 20,
}


def drawn(client, document=None, accept=None):
    headers = {} if accept is None else {"Accept": accept}
    return client.post("/v1/atlases", json=document or ATLAS, headers=headers)


def test_an_atlas_tells_parts_windows_and_changes(client):
    answer = drawn(client)
    assert answer.status_code == 200, answer.text
    atlas = answer.json()
    assert (atlas["lambda"], atlas["verdict"], atlas["undecided"]) == ([0.5, 3.0], "admissible", [])
    assert [change["kind"] for change in atlas["changes"]] == ["window_appears", "windows_merge"]
    assert [len(part["samples"]["windows"]) for part in atlas["parts"]] == [0, 1, 1]
    assert [part["samples"]["windows"][0]["has_mirror_image"] for part in atlas["parts"][1:]] == [True, False]
    for change in atlas["changes"]:
        # As narrow as stretches are cut: 1e-9 of λ, and their neighbours.
        assert 0 < change["lambda"]["error"] < 1e-8
    ends = [end for part in atlas["parts"] for end in part["lambda"]]
    assert ends == sorted(ends)


def test_every_window_can_be_asked_of_a_motion(client):
    """What the atlas draws at one λ is what a validation of a motion with this λ lists."""
    part = drawn(client).json()["parts"][1]
    k = len(part["samples"]["lambda"]) // 2
    question = {name: ATLAS[name] for name in ("body", "potential")}
    motion = {"type": "planar", "lambda": part["samples"]["lambda"][k]}
    found = client.post("/v1/validations", json={**question, "motion": motion}).json()["motions"]
    (window,) = part["samples"]["windows"]
    assert [(each["kind"], each["ends"]) for each in found] == [(window["kind"], window["ends"])]
    for side in (0, 1):
        assert abs(found[0]["g1"][side] - window["g1"][side][k]) <= window["g1_error"][side][k]


def test_columns_are_the_same_in_every_format(client):
    atlas = drawn(client).json()
    lines = drawn(client, accept="text/csv").text.splitlines()
    table = pa.ipc.open_stream(io.BytesIO(drawn(client, accept=ARROW).content)).read_all()
    rows = sum(len(p["samples"]["lambda"]) * len(p["samples"]["windows"]) for p in atlas["parts"])
    assert table.num_rows == rows == len(lines) - 1
    assert table.column_names == lines[0].split(",")
    told = [x for p in atlas["parts"][1:] for x in p["samples"]["windows"][0]["period"]]
    assert table.column("period").to_pylist() == told
    changes = json.loads(table.schema.metadata[b"changes"])
    assert changes == atlas["changes"]


def test_a_picture_is_an_svg_document_with_a_band_for_every_window(client):
    answer = drawn(client, accept="image/svg+xml")
    assert answer.headers["content-type"].startswith("image/svg+xml")
    picture = ET.fromstring(answer.text)
    space = "{http://www.w3.org/2000/svg}"
    # One window with its mirror image, then one.
    assert len(picture.findall(f"{space}polygon")) == 3
    assert len(picture.findall(f"{space}line[@class='change']")) == 2


def test_periods_are_left_out_where_they_are_not_asked(client):
    atlas = drawn(client, {**ATLAS, "outputs": []}).json()
    assert all(w["period"] is None for part in atlas["parts"] for w in part["samples"]["windows"])


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_of_bodies_have_atlases(client, name):
    """Reading alone does not tell: what is read may be refused."""
    example = EXAMPLES[name]["value"]
    status = 202 if "stability" in example.get("outputs", ()) else 200
    assert drawn(client, example).status_code == status


@pytest.mark.parametrize(
    ("change", "pointer", "code"),
    [
        ({"lambda": [3, 1]}, "/lambda/1", "out_of_range"),
        ({"lambda": [1, 1]}, "/lambda/1", "out_of_range"),
        ({"lambda": [0, 1]}, "/lambda/0", "out_of_range"),
        ({"lambda": [1, "1e10"]}, "/lambda/1", "out_of_range"),
        ({"lambda": [1]}, "/lambda", "invalid_length"),
        ({"lambda": 1}, "/lambda", "invalid_type"),
        ({"samples": 3}, "/samples", None),
        ({"outputs": ["stability"]}, "/body/B", "missing_moment"),
        ({"body": {"A": 1, "C": 1}}, "/body", "equal_moments"),
        ({"motion": {}}, "/motion", "unknown_field"),
    ],
)
def test_bad_input_is_told_with_its_place(client, change, pointer, code):
    answer = drawn(client, {**ATLAS, **change})
    assert answer.status_code == 422, answer.text
    problem = answer.json()
    assert problem["type"] == "urn:polhode:problem:invalid_problem"
    found = [(fault["pointer"], fault["code"]) for fault in problem["errors"]]
    assert pointer in [place for place, _ in found]
    assert code is None or (pointer, code) in found


def test_what_has_no_atlas_is_refused(client):
    inadmissible = {**ATLAS, "potential": {"type": "gravity", "a": 1, "b": 1}}
    answer = drawn(client, inadmissible).json()
    assert answer["type"] == "urn:polhode:problem:inadmissible_potential"
    assert answer["counterexample"]["residual"]
    assert drawn(client, accept="image/png").status_code == 406


def test_what_is_seen_and_not_proved_says_so_in_every_format(client):
    # It takes a sixth of a second: on a busy machine, too, it is drawn at once.
    by_integral = {
        "body": {"A": 2, "C": 1},
        "potential": {"type": "general", "F": "-w^2", "G": "0"},
        "lambda": ["1/2", 2],
        "samples": 9,
        "outputs": [],
    }
    answer = drawn(client, by_integral)
    assert answer.status_code == 200, answer.text
    assert [part["proof"] for part in answer.json()["parts"]] == ["seen"]
    rows = list(csv.DictReader(drawn(client, by_integral, accept="text/csv").text.splitlines()))
    assert {row["proof"] for row in rows} == {"seen"}
    assert "seen and not proved" in drawn(client, by_integral, accept="image/svg+xml").text
    proved = drawn(client, ATLAS).json()
    assert {each["proof"] for each in [*proved["parts"], *proved["changes"]]} == {"proved"}


def test_a_picture_shows_no_noise_and_no_empty_panel(client):
    """V = Q G(g2) has the energy 0 on every curve, known up to its error; no window here is periodic."""
    asked = {
        "body": {"A": 3, "C": 2},
        "potential": {"type": "expression", "expression": "(3*g1^2 + 2*g3^2)*g2*(g2 - 2)"},
        "lambda": ["1/5", 5],
        "samples": 20,
    }
    (part,) = drawn(client, asked).json()["parts"]
    assert [window["kind"] for window in part["samples"]["windows"]] == ["pole"]
    picture = ET.fromstring(drawn(client, asked, "image/svg+xml").content)
    name = "{http://www.w3.org/2000/svg}"
    assert "period" not in [each.text for each in picture.iter(f"{name}text")]
    (energy,) = picture.iter(f"{name}polyline")
    assert len({point.split(",")[1] for point in energy.get("points").split()}) == 1
