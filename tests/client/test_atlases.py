"""Atlases over the live service: at once and by a job, as arrays, frames and pictures."""

import asyncio
import json
import urllib.request
import xml.etree.ElementTree as ET

import numpy as np
import pyarrow as pa
import pytest

import polhode as ph

TEXT = "a*g1 + b/g3^2 + c*(g1^2 - g2^2)"
NUMBERS = {"a": -1, "b": "1/20", "c": "3/2"}
DOCUMENT = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "expression", "expression": TEXT, "parameters": NUMBERS},
    "lambda": ["1/2", 3],
    "samples": 20,
}


def answered(service, accept):
    """Return the bytes of the service's own answer."""
    headers = {"Content-Type": "application/json", "Accept": accept}
    body = json.dumps(DOCUMENT).encode()
    request = urllib.request.Request(service.address + "/v1/atlases", body, headers)
    with urllib.request.urlopen(request, timeout=120) as answer:
        return answer.read()


@pytest.fixture
def atlas(connected):
    return connected.atlas(TEXT, body=(2, 1), lam=("1/2", 3), samples=20, **NUMBERS)


def test_an_atlas_tells_what_the_service_tells(service, atlas):
    told = service.call("POST", "/v1/atlases", DOCUMENT).document
    assert atlas.document == told
    assert atlas.question == DOCUMENT
    assert (atlas.verdict, atlas.lam, atlas.undecided, atlas.id) == ("admissible", (0.5, 3.0), (), None)
    assert [change.kind for change in atlas.changes] == [change["kind"] for change in told["changes"]]
    for change, own in zip(atlas.changes, told["changes"], strict=True):
        assert (float(change.lam), change.lam.error) == (own["lambda"]["value"], own["lambda"]["error"])
    for part, own in zip(atlas.parts, told["parts"], strict=True):
        assert [part.lower, part.upper] == own["lambda"]
        assert part.lam.tolist() == own["samples"]["lambda"]
        assert part.energy.tolist() == own["samples"]["energy"]
        assert len(part.bands) == len(own["samples"]["windows"])
        for band, window in zip(part.bands, own["samples"]["windows"], strict=True):
            assert (band.kind, list(band.ends)) == (window["kind"], window["ends"])
            assert band.has_mirror_image == window["has_mirror_image"]
            assert band.g1.tolist() == window["g1"]
            assert band.g2_error.tolist() == window["g2_error"]
            assert band.period.shape == part.lam.shape
    assert repr(atlas) == "<atlas of λ from 0.5 to 3: 3 parts, 2 changes>"


def test_its_table_and_frame_are_those_of_the_service(connected, service, atlas):
    expected = pa.ipc.open_stream(answered(service, "application/vnd.apache.arrow.stream")).read_all()
    table = atlas.table()
    assert table.column_names == expected.column_names
    for name in table.column_names:
        if table.schema.field(name).type == pa.string():
            assert table.column(name).to_pylist() == [str(each) for each in expected.column(name).to_pylist()]
            continue
        ours, theirs = (each.column(name).to_numpy().astype(float) for each in (table, expected))
        np.testing.assert_array_equal(ours, theirs, name)
    assert atlas.frame().equals(table.to_pandas())
    empty = connected.atlas(TEXT, body=(2, 1), lam=("1/2", "3/5"), **NUMBERS)
    assert len(empty.frame()) == 0
    assert list(empty.frame().columns) == table.column_names


def test_its_picture_is_that_of_the_service(service, atlas):
    picture = atlas.svg()
    assert picture == atlas._repr_svg_() == atlas.svg()
    assert ET.fromstring(picture).tag.endswith("svg")
    assert picture == answered(service, "image/svg+xml").decode()


def test_one_that_takes_long_is_waited_for_and_stored(connected):
    asked = {
        "body": (2, "3/2", 1),
        "lam": ("3/5", "31/50"),
        "samples": 9,
        "outputs": ["period", "stability"],
    }
    atlas = connected.atlas("-g1 + 1/(20*g3^2)", **asked)
    assert atlas.id is not None
    (part,) = atlas.parts
    (band,) = part.bands
    assert set(band.stability["verdict"]) == {"stable"}
    again = connected.stored_atlas(atlas.id)
    assert again.document == atlas.document
    assert again.svg() == atlas.svg()
    with pytest.raises(ph.UnfinishedError):
        connected.atlas("-g1 + 1/(10*g3^2)", **asked, seconds=0)


def test_in_an_event_loop(service, atlas, tmp_path):
    async def drawn():
        async with ph.connect_async(service.address, cache=str(tmp_path)) as client:
            found = await client.atlas(DOCUMENT)
            assert found._repr_svg_() is None
            picture = await found.svg()
            assert found._repr_svg_() == picture
            return found, picture

    found, picture = asyncio.run(drawn())
    assert found.document == atlas.document
    assert picture == atlas.svg()


def test_a_file_and_signs_and_a_reason(connected, tmp_path):
    file = tmp_path / "atlas.json"
    file.write_text(
        '{"body": {"A": 2, "C": 1}, "potential": {"type": "expression", '
        '"expression": "(2*g1^2+g3^2)*sin(1/g2)"}, "lambda": [1, 2]}'
    )
    atlas = connected.atlas(file, g1_sign=-1, lam=(1, 3), samples=9)
    assert atlas.question["g1_sign"] == -1
    assert atlas.lam == (1.0, 3.0)
    (part,) = atlas.parts
    assert (part.bands, part.reason["code"]) == ((), "essential_singularity")


def test_mistakes_are_told(connected):
    with pytest.raises(ph.WrongArgumentError, match="did you mean"):
        connected.atlas("bb*g1", body=(2, 1), lam=(1, 2), b=1)
    with pytest.raises(ph.RefusedError) as refused:
        connected.atlas("g1", body=(2, 1), lam=(2, 1))
    assert refused.value.faults[0].pointer == "/lambda/1"
    with pytest.raises(ph.RefusedError):
        connected.atlas("g2", body=(2, 1), lam=(1, 2))
    with pytest.raises(ph.MissingError):
        connected.stored_atlas("0" * 32)
