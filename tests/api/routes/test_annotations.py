"""Labels and notes: given with jobs and sweeps, changed by PATCH, asked for, and no part of a problem."""

import re
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import func, select

from service.jobs.keys import Role
from service.schemas.reading.documents import Annotation, patched
from service.storage.inspection.inspect import inspect
from service.storage.tables.jobs import JobLabelRow, SolutionLabelRow, SweepLabelRow
from tests.support.api import STATE, finish
from tests.support.keys import make
from tests.support.sweeps import SWEEP, finish_sweep

pytestmark = pytest.mark.any_database

MERGE_PATCH = "application/merge-patch+json"
MARKED = {**STATE, "labels": {"run": "7", "project": "thesis"}, "note": "first try"}
OTHER = {**STATE, "time": {"stop": 21, "samples": 3}}


def patch(client, path, change, **headers):
    return client.request("PATCH", path, json=change, headers={"Content-Type": MERGE_PATCH, **headers})


def annotations_of(client, path, **headers):
    document = client.get(path, headers=headers).json()
    return document["labels"], document["note"]


def code_of(response):
    return response.status_code, response.json()["type"].rpartition(":")[2]


def faults_of(response):
    return {(each["pointer"], each["code"]) for each in response.json()["errors"]}


@pytest.fixture
def solved(client, jobs):
    assert client.post("/v1/jobs", json=MARKED).status_code == 202
    return finish(jobs)


@pytest.fixture(params=["jobs", "solutions", "sweeps"])
def path(request, client, solved, jobs):
    """Something with the labels and the note above."""
    if request.param == "sweeps":
        answer = client.post("/v1/sweeps", json={**SWEEP, "labels": MARKED["labels"], "note": "first try"})
        finish_sweep(jobs)
        return f"/v1/sweeps/{answer.json()['id']}"
    return f"/v1/{request.param}/{solved.job.id if request.param == 'jobs' else solved.solution_id}"


def test_they_are_given_with_a_job_and_are_no_part_of_its_problem(client, jobs):
    answer = client.post("/v1/jobs", json=MARKED).json()
    assert (answer["labels"], answer["note"]) == (MARKED["labels"], "first try")
    assert answer["problem"] == STATE
    stored = finish(jobs)
    assert annotations_of(client, f"/v1/solutions/{stored.solution_id}") == (MARKED["labels"], "first try")
    # The same problem with other labels is the same problem; its labels are its own.
    again = client.post("/v1/jobs", json={**STATE, "labels": {"project": "other"}}).json()
    assert (again["solution"], again["reused"]) == (stored.solution_id, True)
    assert (again["labels"], again["note"]) == ({"project": "other"}, None)
    assert annotations_of(client, f"/v1/solutions/{stored.solution_id}") == (MARKED["labels"], "first try")


def test_each_problem_of_a_list_has_its_own(client):
    sent = [MARKED, {**OTHER, "labels": {"no key!": "x"}}, {**OTHER, "note": "second"}]
    items = client.post("/v1/jobs", json=sent).json()["items"]
    assert [item["status"] for item in items] == [202, 422, 202]
    assert [items[n]["job"]["labels"] for n in (0, 2)] == [MARKED["labels"], {}]
    assert [items[n]["job"]["note"] for n in (0, 2)] == ["first try", "second"]
    assert items[1]["problem"]["errors"][0]["pointer"] == "/labels/no key!"


def test_a_sweep_has_them_beside_its_document(client):
    sent = {**SWEEP, "labels": {"project": "thesis"}, "note": "wide"}
    sweep = client.post("/v1/sweeps", json=sent).json()
    assert (sweep["labels"], sweep["note"], sweep["document"]) == ({"project": "thesis"}, "wide", SWEEP)


@pytest.mark.parametrize(
    ("fields", "code", "places"),
    [
        ({"labels": {"": "x"}}, "invalid_label", ["/labels/"]),
        ({"labels": {"-a": "x", "a" * 64: "x"}}, "invalid_label", ["/labels/-a", "/labels/" + "a" * 64]),
        ({"labels": {"a": "", "b": "x" * 129}}, "invalid_label", ["/labels/a", "/labels/b"]),
        ({"labels": {"a": 1, "b": None}}, "invalid_type", ["/labels/a", "/labels/b"]),
        ({"labels": {"a": "x\ny", "b": "x\x7f"}}, "invalid_label", ["/labels/a", "/labels/b"]),
        ({"labels": {f"k{n}": "x" for n in range(17)}}, "invalid_length", ["/labels"]),
        ({"labels": ["a"], "note": 1}, "invalid_type", ["/labels", "/note"]),
        ({"note": "x" * 2001}, "invalid_note", ["/note"]),
        ({"note": "bell \x07"}, "invalid_note", ["/note"]),
    ],
)  # fmt: skip
def test_faults_of_labels_and_notes_are_told_with_all_others(client, fields, code, places):
    unknown = {"lables": {}}
    for path, sent in (("/v1/jobs", STATE), ("/v1/sweeps", SWEEP)):
        answer = client.post(path, json={**sent, **fields, **unknown})
        assert answer.status_code == 422
        assert faults_of(answer) == {*((place, code) for place in places), ("/lables", "unknown_field")}
        told = next(each["message"] for each in answer.json()["errors"] if each["pointer"] == "/lables")
        assert told.endswith("labels, note")


def test_the_longest_are_accepted(client):
    labels = {f"{n:02}{'_.-'.ljust(60, 'x')}Z": "ü" * 128 for n in range(16)}
    assert {len(key) for key in labels} == {63}
    answer = client.post("/v1/jobs", json={**STATE, "labels": labels, "note": "ü\n\t" + "x" * 1997})
    assert answer.status_code == 202
    assert answer.json()["labels"] == labels


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("change", "labels", "note"),
    [
        ({}, MARKED["labels"], "first try"),
        ({"labels": {"run": "8"}}, {"project": "thesis", "run": "8"}, "first try"),
        ({"labels": {"run": None, "new": "a, b"}}, {"new": "a, b", "project": "thesis"}, "first try"),
        ({"labels": None}, {}, "first try"),
        ({"labels": {}, "note": None}, MARKED["labels"], None),
        ({"labels": {"missing": None}, "note": "second"}, MARKED["labels"], "second"),
    ],
)
def test_a_merge_patch_changes_them(client, database, path, change, labels, note):
    before = client.get(path)
    answer = patch(client, path, change)
    assert answer.status_code == 200, answer.text
    after = client.get(path)
    assert answer.json() == after.json() == {**before.json(), "labels": labels, "note": note}
    assert answer.headers["etag"] == after.headers["etag"]
    assert (before.headers["etag"] == after.headers["etag"]) == (before.json() == after.json())
    assert after.headers["cache-control"] == "no-cache"
    known = client.get(path, headers={"If-None-Match": before.headers["etag"]})
    assert known.status_code == (304 if before.json() == after.json() else 200)
    assert [finding.code for finding in inspect(database) if finding.broken] == []


def test_plain_json_is_accepted_too(client, path):
    assert client.patch(path, json={"note": "plain"}).json()["note"] == "plain"
    answer = client.request("PATCH", path, content="{}", headers={"Content-Type": "text/plain"})
    assert code_of(answer) == (415, "unsupported_media_type")
    assert answer.headers["accept-patch"] == f"{MERGE_PATCH}, application/json"


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("change", "faults"),
    [
        ({"state": "failed"}, {("/state", "unknown_field")}),
        ({"labels": {"a b": "x", "c": ""}, "note": 3},
         {("/labels/a b", "invalid_label"), ("/labels/c", "invalid_label"), ("/note", "invalid_type")}),
        ({"labels": {f"k{n}": "x" for n in range(15)}}, {("/labels", "invalid_length")}),
        ([], {("", "invalid_type")}),
    ],
)  # fmt: skip
def test_a_change_that_is_not_valid_changes_nothing(client, path, change, faults):
    before = client.get(path).json()
    answer = patch(client, path, change)
    assert code_of(answer) == (422, "invalid_patch")
    assert faults_of(answer) == faults
    assert client.get(path).json() == before


def test_no_change_is_lost_if_the_tag_is_sent(client, path):
    tag = client.get(path).headers["etag"]
    plain = re.sub(r"-\w+\"", '"', tag)
    for header in (tag, f'"other", {tag}', "*", plain, plain[:-1] + '-gzip"'):
        answer = patch(client, path, {}, **{"If-Match": header})
        assert answer.status_code == 200
    assert patch(client, path, {"note": "mine"}, **{"If-Match": tag}).status_code == 200
    for header in (tag, f"W/{tag}", '"other"', "no tag"):
        answer = patch(client, path, {"note": "theirs"}, **{"If-Match": header})
        assert code_of(answer) == (412, "changed_meanwhile")
    weak = "W/" + client.get(path).headers["etag"]
    assert patch(client, path, {"note": "theirs"}, **{"If-Match": weak}).status_code == 412
    assert annotations_of(client, path)[1] == "mine"


def test_of_changes_at_once_with_one_tag_a_single_one_happens(client, path):
    tag = client.get(path).headers["etag"]

    def change(number):
        return patch(client, path, {"labels": {"winner": str(number)}}, **{"If-Match": tag})

    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(change, range(4)))
    assert sorted(answer.status_code for answer in answers) == [200, 412, 412, 412]
    (winner,) = (n for n, answer in enumerate(answers) if answer.status_code == 200)
    assert annotations_of(client, path)[0]["winner"] == str(winner)


def test_of_changes_at_once_without_a_tag_none_is_lost(client, path):
    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(lambda n: patch(client, path, {"labels": {f"k{n}": "x"}}), range(8)))
    assert {answer.status_code for answer in answers} == {200}
    assert annotations_of(client, path)[0] == {**MARKED["labels"], **{f"k{n}": "x" for n in range(8)}}


def test_only_operators_change_what_is_not_theirs(client, database, jobs):
    (_, mine), (_, theirs) = make(database, Role.SUBMIT), make(database, Role.SUBMIT)
    (_, reader), (_, operator) = make(database, Role.READ), make(database, Role.OPERATE)
    job = client.post("/v1/jobs", json=STATE, headers=mine).json()["id"]
    solution = finish(jobs).solution_id
    sweep = client.post("/v1/sweeps", json=SWEEP, headers=mine).json()["id"]
    for path in (f"/v1/jobs/{job}", f"/v1/solutions/{solution}", f"/v1/sweeps/{sweep}"):
        for header in (theirs, reader):
            assert patch(client, path, {"note": "no"}, **header).status_code == 403
        for note, header in (("mine", mine), ("operator", operator)):
            assert patch(client, path, {"note": note}, **header).status_code == 200
            assert annotations_of(client, path, **reader) == ({}, note)
    missing = f"/v1/jobs/{solution}"
    assert patch(client, missing, {}, **operator).status_code == 404


def test_a_job_and_its_solution_have_their_own_after_its_success(client, jobs):
    job = f"/v1/jobs/{client.post('/v1/jobs', json=MARKED).json()['id']}"
    # What a queued job has in the moment of its success is what its solution gets.
    patch(client, job, {"labels": {"run": None}, "note": "second"})
    solution = f"/v1/solutions/{finish(jobs).solution_id}"
    assert annotations_of(client, solution) == ({"project": "thesis"}, "second")
    patch(client, job, {"labels": {"project": "job"}, "note": None})
    assert annotations_of(client, solution) == ({"project": "thesis"}, "second")
    patch(client, solution, {"labels": {"project": "solution"}})
    assert annotations_of(client, job) == ({"project": "job"}, None)


def test_all_lists_are_asked_by_labels(client, path):
    resource = path.rpartition("/")[0]
    found = path.rpartition("/")[2]

    def ask(**query):
        answer = client.get(resource, params=query)
        assert answer.status_code == 200, answer.text
        return [item["id"] for item in answer.json()["items"]]

    for where in (
        "label.project=thesis", "label.project=thesis,label.run=7", "label.run in (6,7)",
        "label.project!=other", "label.run is not null", "label.other is null",
    ):  # fmt: skip
        assert ask(where=where) == [found]
        assert ask(where=where, order="-label.run,id") == [found]
    for where in ("label.project=Thesis", "label.project!=thesis", "label.other=x", "label.run is null"):
        assert ask(where=where) == []
    columns = client.get(resource, params={"columns": "id,label.project,label.other"}).json()["items"]
    assert columns == [{"id": found, "label.project": "thesis", "label.other": None}]
    refused = client.get(resource, params={"where": "label.a b=1,label.run<3"})
    assert {fault["code"] for fault in refused.json()["errors"]} == {"invalid_condition"}
    refused = client.get(resource, params={"where": "label.-a=1"})
    assert faults_of(refused) == {("?where", "invalid_label")}


@pytest.mark.parametrize("resource", ["jobs", "solutions"])
def test_facets_and_groups_are_told_by_labels(client, solved, resource):
    facets = client.get(f"/v1/{resource}/facets?by=label.project,label.other").json()["facets"]
    assert facets == [
        {"by": "label.project", "values": [{"value": "thesis", "count": 1}], "others": 0},
        {"by": "label.other", "values": [{"value": None, "count": 1}], "others": 0},
    ]
    where = "label.project=thesis"
    answer = client.get(
        f"/v1/{resource}/statistics", params={"of": "period", "by": "label.run", "where": where}
    )
    assert [(item["group"], item["count"]) for item in answer.json()["items"]] == [("7", 1)]
    refused = client.get(f"/v1/{resource}/statistics?of=label.run")
    assert faults_of(refused) == {("?of", "unknown_column")}
    assert "label" not in refused.json()["errors"][0]["message"].partition("accepted are")[2]


def test_labels_go_with_what_has_them(client, database, path):
    answer = client.delete(path)
    if answer.status_code == 409:  # a job that a solution comes from is deleted with it
        answer = client.delete(answer.json()["referrers"][0])
    assert answer.status_code == 204
    table = {"jobs": JobLabelRow, "solutions": SolutionLabelRow, "sweeps": SweepLabelRow}[path.split("/")[2]]
    with database.read() as session:
        assert session.scalar(select(func.count()).select_from(table)) == 0


texts = st.text(st.sampled_from("ab"), min_size=1, max_size=2)
labels = st.dictionaries(texts, texts, max_size=3)


def merge_patch(target, change):
    """RFC 7396, section 2, word by word."""
    if not isinstance(change, dict):
        return change
    target = dict(target) if isinstance(target, dict) else {}
    for name, value in change.items():
        if value is None:
            target.pop(name, None)
        else:
            target[name] = merge_patch(target.get(name), value)
    return target


@given(labels, st.none() | texts, st.fixed_dictionaries({}, optional={
    "labels": st.none() | st.dictionaries(texts, st.none() | texts, max_size=3), "note": st.none() | texts,
}))  # fmt: skip
def test_a_change_is_what_the_rfc_says(given_labels, note, change):
    annotation = patched(Annotation(given_labels, note), change)
    document = {"labels": given_labels, **({} if note is None else {"note": note})}
    merged = merge_patch(document, change)
    assert annotation == Annotation(dict(sorted(merged.get("labels", {}).items())), merged.get("note"))
