"""Lists as CSV, NDJSON, Arrow and Parquet: the same rows as the pages of JSON, whatever their number."""

import csv
import io
import json

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from service.api.formats import lists
from tests.support.api import STATE
from tests.support.sweeps import SWEEP

pytestmark = pytest.mark.any_database

COLUMNS = "id,state,created_at,seconds,reused,label.name,/time/stop"
LABEL = 'one, "two"'
FORMATS = {"csv": "text/csv", "ndjson": "application/x-ndjson"}


@pytest.fixture
def made(client, monkeypatch):
    """Seven jobs and a solution, and so short pages that a table has several."""
    monkeypatch.setattr(lists, "_TABLE_ROWS", 3)
    monkeypatch.setattr(lists, "_WHOLE_ROWS", 2)
    for stop in range(1, 8):
        problem = {**STATE, "time": {"stop": stop, "samples": 3}, "labels": {"name": LABEL}}
        assert client.post("/v1/jobs", json=problem).status_code == 202


def paged(client, path, **query):
    """Return the items of all pages of JSON."""
    found, page = [], client.get(path, params={**query, "limit": 2}).json()
    while True:
        found += page["items"]
        if page["next"] is None:
            return found
        page = client.get(path + page["next"]).json()


@pytest.mark.parametrize("query", [{}, {"order": "/time/stop"}, {"order": "-seconds,id"}, {"offset": 3}])
def test_csv_has_the_rows_of_all_pages(client, made, query):
    answer = client.get("/v1/jobs", params={**query, "columns": COLUMNS, "format": "csv"})
    assert answer.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(answer.text, newline="")))
    expected = paged(client, "/v1/jobs", **query, columns=COLUMNS)
    assert len(rows) == len(expected) > 3
    for row, item in zip(rows, expected, strict=True):
        texts = {"reused": json.dumps(item["reused"]), "seconds": "", "/time/stop": repr(item["/time/stop"])}
        assert item["seconds"] is None
        assert row == {**item, **texts}
        assert row["label.name"] == LABEL


@pytest.mark.parametrize("name", ["arrow", "parquet"])
def test_arrow_and_parquet_have_kinds(client, made, name):
    answer = client.get("/v1/jobs", params={"columns": COLUMNS, "format": name})
    stream = io.BytesIO(answer.content)
    table = pa.ipc.open_stream(stream).read_all() if name == "arrow" else pq.read_table(stream)
    kinds = {"created_at": pa.timestamp("us", tz="UTC"), "seconds": pa.float64(), "reused": pa.bool_()}
    assert {each: table.schema.field(each).type for each in kinds} == kinds
    items = paged(client, "/v1/jobs", columns=COLUMNS)
    assert table.num_rows == len(items)
    for row, item in zip(table.to_pylist(), items, strict=True):
        instant = row["created_at"].isoformat().replace("+00:00", "Z")
        assert {**row, "created_at": instant} == item


def test_ndjson_has_whole_items_or_the_wanted_columns(client, made):
    lines = client.get("/v1/jobs", headers={"Accept": FORMATS["ndjson"]}).text.splitlines()
    assert [json.loads(line) for line in lines] == paged(client, "/v1/jobs")
    lines = client.get("/v1/jobs", params={"format": "ndjson", "columns": COLUMNS}).text.splitlines()
    assert [json.loads(line) for line in lines] == paged(client, "/v1/jobs", columns=COLUMNS)


def test_a_table_without_columns_has_all_facts(client, made):
    header = client.get("/v1/jobs", headers={"Accept": "text/csv"}).text.split("\r\n")[0].split(",")
    assert header[:2] == ["id", "solution"]
    assert {"state", "created_at", "period", "error.code"} <= set(header)


@pytest.mark.parametrize(("limit", "rows"), [(1, 1), (3, 3), (4, 4), (300, 7)])
def test_limit_bounds_the_rows_of_a_table(client, made, limit, rows):
    answer = client.get("/v1/jobs", params={"limit": limit, "format": "csv", "columns": "id"})
    assert len(answer.text.splitlines()) == 1 + rows


def test_a_page_of_json_stays_bounded(client):
    refusal = client.get("/v1/jobs?limit=201").json()
    assert [fault["pointer"] for fault in refusal["errors"]] == ["?limit"]
    assert "from 1 to 200" in refusal["detail"]


def test_an_empty_list_is_a_table_without_rows(client):
    assert len(client.get("/v1/sweeps?format=csv").text.splitlines()) == 1
    assert client.get("/v1/sweeps?format=ndjson").text == ""
    table = pa.ipc.open_stream(io.BytesIO(client.get("/v1/sweeps?format=arrow").content)).read_all()
    assert table.num_rows == 0


@pytest.mark.one_in(3)
@pytest.mark.parametrize("path", ["/v1/solutions", "/v1/sweeps", "/v1/atlases"])
@pytest.mark.parametrize("name", FORMATS)
def test_every_list_is_a_table(client, stored, path, name):
    client.post("/v1/sweeps", json=SWEEP)
    answer = client.get(path, headers={"Accept": FORMATS[name]})
    assert answer.headers["content-type"].partition(";")[0] == FORMATS[name]
    ids = [item["id"] for item in paged(client, path)]
    lines = answer.text.splitlines()
    found = (
        [json.loads(line)["id"] for line in lines]
        if name == "ndjson"
        else [row["id"] for row in csv.DictReader(lines)]
    )
    assert found == ids


@pytest.mark.parametrize("path", ["/v1/jobs", "/v1/solutions", "/v1/sweeps"])
def test_a_format_that_there_is_not_is_refused(client, path):
    refusal = client.get(path, headers={"Accept": "application/xml"})
    assert (refusal.status_code, refusal.json()["type"].rpartition(":")[2]) == (406, "not_acceptable")
    assert "text/csv" in refusal.json()["detail"]
    by_name = client.get(path, params={"format": "npz"})
    assert (by_name.status_code, by_name.json()["errors"][0]["pointer"]) == (422, "?format")
    assert "csv" in by_name.json()["detail"]


def test_provenance_is_json_alone(client, stored):
    path = f"/v1/solutions/{stored.solution_id}/provenance"
    assert client.get(path, headers={"Accept": "text/csv"}).status_code == 406
    assert client.get(path, headers={"Accept": "text/html, */*;q=0.1"}).status_code == 200


def test_a_table_is_read_while_it_is_sent(client, made, monkeypatch):
    """No page is asked for before the one in front of it has been written: memory holds one."""
    asked = []
    find = type(client.app.state.resources.jobs).find
    monkeypatch.setattr(
        type(client.app.state.resources.jobs),
        "find",
        lambda self, query: asked.append(query) or find(self, query),
    )
    client.get("/v1/jobs?format=csv&columns=id")
    assert [query.limit for query in asked] == [3, 3, 3]
    assert [query.after is None for query in asked] == [True, False, False]
    assert not any(query.is_counted for query in asked)
