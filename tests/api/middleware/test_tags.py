"""Tags of answers: what changes them, and how lists of them are read."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.api.replies import REVALIDATE, coded, matching_tag, tag_of_content
from service.storage.upkeep.retention import prune_samples
from tests.support.api import STATE, ask_again, finish
from tests.support.sweeps import SWEEP, finish_sweep

pytestmark = pytest.mark.any_database


def test_another_format_query_or_solution_has_another_tag(client, stored, jobs):
    path = f"/v1/solutions/{stored.solution_id}/trajectory"
    assert client.post("/v1/jobs", json={**STATE, "time": {"stop": 3, "samples": 2}}).status_code == 202
    other = finish(jobs)
    answers = [
        client.get(path),
        client.get(path, headers={"Accept": "text/csv"}),
        client.get(path, params={"columns": "t,g1"}),
        client.get(path, params={"columns": "g1,t"}),
        client.get(path, params={"stop": 3, "samples": 2}),
        client.get(path, params={"stop": 3, "samples": 3}),
        client.get(f"/v1/solutions/{other.solution_id}/trajectory"),
    ]
    tags = [answer.headers["etag"] for answer in answers]
    assert len(set(tags)) == len(tags)
    same = client.get(path, params={"samples": 2, "stop": 3}).headers["etag"]
    assert same == answers[4].headers["etag"]
    # A tag of JSON does not keep CSV from being sent.
    assert ask_again(client, path, answers[0], Accept="text/csv").status_code == 200


def test_samples_that_are_made_again_have_another_tag(client, stored, database):
    path = f"/v1/solutions/{stored.solution_id}/trajectory"
    first = client.get(path)
    assert prune_samples(database, older_than_seconds=-60.0).solutions == 1
    again = ask_again(client, path, first)
    assert (again.status_code, again.headers["polhode-samples"]) == (200, "evaluated")
    assert again.headers["etag"] != first.headers["etag"]


def test_a_tag_changes_with_each_change_of_a_job_and_of_a_sweep(client, jobs):
    job = client.post("/v1/jobs", json=STATE).json()
    sweep = client.post("/v1/sweeps", json=SWEEP).json()
    paths = [
        f"/v1/jobs/{job['id']}",
        "/v1/jobs",
        f"/v1/sweeps/{sweep['id']}",
        "/v1/sweeps",
        f"/v1/sweeps/{sweep['id']}/points",
    ]
    answers = {path: client.get(path) for path in paths}
    for path, answer in answers.items():
        assert answer.headers["cache-control"] == REVALIDATE
        assert ask_again(client, path, answer).status_code == 304, path
    finish(jobs)
    finish_sweep(jobs, chunks=1)
    for path, answer in answers.items():
        again = ask_again(client, path, answer)
        assert (again.status_code, again.headers["etag"] != answer.headers["etag"]) == (200, True), path


def test_a_bad_query_is_refused_although_a_tag_is_sent(client, stored):
    path = f"/v1/solutions/{stored.solution_id}/trajectory"
    for known in ("*", client.get(path).headers["etag"]):
        refused = client.get(path, params={"columns": "t,x"}, headers={"If-None-Match": known})
        assert refused.status_code == 422


TAGS = st.binary(max_size=8).map(tag_of_content)


@given(tag=TAGS, others=st.lists(TAGS), place=st.integers(0, 9), coding=st.sampled_from(["", "gzip", "zstd"]))
def test_a_tag_is_found_anywhere_in_a_list(tag, others, place, coding):
    own = coded(tag, coding) if coding else tag
    rest = [other for other in others if other != tag]
    assert matching_tag(", ".join(rest), tag) is None
    listed = [*rest[:place], f"W/{own}", *rest[place:]]
    assert matching_tag(" ,".join(listed), tag) == own


@pytest.mark.parametrize("header", [None, "", "*", "x", '"', "W/", '"a" "b"', 'w/"a"', '"a'])
def test_what_is_no_list_of_tags_matches_nothing(header):
    assert matching_tag(header, '"b"') is None
