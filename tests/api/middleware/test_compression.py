"""Content codings: the same answer in each, and bodies that are limited after they are unpacked."""

import gzip
import json
import tracemalloc
import zlib

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from service.api.dependencies import MAX_BODY_BYTES
from service.api.formats.negotiation import (
    ACCEPTED,
    CodingError,
    decoded,
    encoded,
    encoder,
    preferred_coding,
)
from tests.support.api import STATE
from tests.support.sweeps import SWEEP, finish_sweep

pytestmark = pytest.mark.any_database

READERS = {
    "gzip": lambda: zlib.decompressobj(31).decompress,  # 31: with the header of gzip
    "zstd": lambda: zstandard.ZstdDecompressor().decompressobj().decompress,
}
DECODERS = {
    "gzip": gzip.decompress,
    "zstd": lambda data: zstandard.ZstdDecompressor().decompressobj().decompress(data),
}


def raw(client, path, coding, **headers):
    """Return the answer with the bytes that were sent."""
    with client.stream("GET", path, headers={"Accept-Encoding": coding, **headers}) as response:
        return response, b"".join(response.iter_raw())


def post(client, content, coding):
    headers = {"Content-Type": "application/json", "Content-Encoding": coding}
    return client.post("/v1/jobs", content=content, headers=headers)


@pytest.mark.parametrize("coding", ACCEPTED)
def test_an_answer_is_the_same_in_every_coding(client, coding):
    for path in ("/v1/families", "/openapi.json", "/docs/swagger-ui-bundle.js"):
        plain, content = raw(client, path, "identity")
        answer, sent = raw(client, path, coding)
        assert (answer.headers["content-encoding"], "content-encoding" in plain.headers) == (coding, False)
        assert DECODERS[coding](sent) == content
        assert int(answer.headers["content-length"]) == len(sent) < len(content)
        assert answer.headers["etag"] == f'{plain.headers["etag"][:-1]}-{coding}"'
        assert "Accept-Encoding" in answer.headers["vary"]
        assert "Accept-Encoding" in plain.headers["vary"]
        # The tag of either is known whatever is accepted now.
        for tag in (plain.headers["etag"], answer.headers["etag"]):
            again = client.get(path, headers={"If-None-Match": tag, "Accept-Encoding": coding})
            assert (again.status_code, again.headers["etag"]) == (304, tag)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("coding", ACCEPTED)
@pytest.mark.parametrize(
    "media_type", ["text/csv", "application/x-ndjson", "application/vnd.apache.arrow.stream"]
)
def test_a_stream_is_the_same_in_every_coding(client, jobs, coding, media_type):
    sweep_id = client.post("/v1/sweeps", json=SWEEP).json()["id"]
    finish_sweep(jobs)
    path = f"/v1/sweeps/{sweep_id}/points"
    plain, content = raw(client, path, "identity", Accept=media_type)
    answer, sent = raw(client, path, coding, Accept=media_type)
    assert answer.headers["content-encoding"] == coding
    assert "content-length" not in answer.headers
    assert (DECODERS[coding](sent), len(sent) < len(content)) == (content, True)
    assert answer.headers["etag"] == f'{plain.headers["etag"][:-1]}-{coding}"'


def test_what_would_not_get_smaller_is_sent_as_it_is(client, stored):
    path = f"/v1/solutions/{stored.solution_id}/trajectory"
    for place, accept in (("/livez", "*/*"), (path, "application/x-npz")):
        answer, content = raw(client, place, "gzip, zstd", Accept=accept)
        assert "content-encoding" not in answer.headers
        assert int(answer.headers["content-length"]) == len(content)
        assert not answer.headers.get("etag", "").endswith(('-gzip"', '-zstd"'))


@pytest.mark.parametrize("coding", ACCEPTED)
@given(pieces=st.lists(st.binary(max_size=300), max_size=6))
def test_each_piece_can_be_decoded_at_once(coding, pieces):
    stream = encoder(coding)
    sent = [stream.piece(piece) for piece in pieces]
    whole = b"".join(sent) + stream.end()
    assert DECODERS[coding](whole) == b"".join(pieces) == decoded(whole, coding, 2000)
    read = READERS[coding]()
    for piece, part in zip(pieces, sent, strict=True):
        assert read(part) == piece


@pytest.mark.parametrize(
    ("header", "coding"),
    [
        (None, None),
        ("", None),
        ("gzip", "gzip"),
        ("zstd, gzip", "zstd"),
        ("gzip;q=1.0, zstd;q=0.5", "gzip"),
        ("GZIP", "gzip"),
        ("*", "zstd"),
        ("*;q=0", None),
        ("zstd;q=0, *", "gzip"),
        ("br, deflate", None),
        ("gzip;q=0", None),
        ("gzip;q=0.5, identity", None),
        ("gzip;q=none", None),
    ],
)
def test_accept_encoding_is_read_as_the_rfc_says(header, coding):
    assert preferred_coding(header) == coding


@pytest.mark.parametrize("coding", [*ACCEPTED, "GZIP"])
def test_a_compressed_body_is_read(client, coding):
    content = encoded(json.dumps(STATE).encode(), coding.lower())
    answer = post(client, content, coding)
    assert (answer.status_code, answer.json()["problem"]) == (202, STATE)


@pytest.mark.parametrize("coding", ACCEPTED)
def test_a_body_that_is_not_in_its_coding_is_refused(client, coding):
    whole = encoded(json.dumps(STATE).encode(), coding)
    for content in (b"{}", whole[:-1], whole[: len(whole) // 2], whole + b"more"):
        answer = post(client, content, coding)
        assert answer.status_code == 400
        assert answer.json()["type"] == "urn:polhode:problem:invalid_encoding"
        with pytest.raises(CodingError):
            decoded(content, coding, MAX_BODY_BYTES)


@pytest.mark.parametrize("coding", ACCEPTED)
def test_a_bomb_is_refused_without_being_unpacked(client, coding):
    bomb = encoded(bytes(10**9), "zstd") if coding == "zstd" else gzip.compress(bytes(10**8), 9)
    assert len(bomb) < MAX_BODY_BYTES
    answer = post(client, bomb, coding)
    assert (answer.status_code, answer.json()["type"]) == (413, "urn:polhode:problem:body_too_large")
    assert "after decompression" in answer.json()["detail"]
    tracemalloc.start()
    assert decoded(bomb, coding, MAX_BODY_BYTES) is None
    # The limit, and what the decompressor and the reader keep: a hundredth of the bomb at most.
    assert tracemalloc.get_traced_memory()[1] < 10 * MAX_BODY_BYTES
    tracemalloc.stop()


@pytest.mark.parametrize("coding", ACCEPTED)
def test_a_body_may_be_as_long_as_the_limit(coding):
    for size, is_read in ((1000, True), (1001, False)):
        assert (decoded(encoded(bytes(size), coding), coding, 1000) == bytes(size)) is is_read
