"""What a paper needs: the citation of a solution, and a sweep as a data package."""

import hashlib
import io
import json
import zipfile
from datetime import date

import pyarrow.parquet as pq
import pytest
import yaml

from service.api.formats.origins import Cited, bibtex, title_of
from service.storage.database.rows import new_id
from tests.support.sweeps import POINTS, SWEEP, finish_sweep

pytestmark = pytest.mark.any_database


def test_a_citation_names_the_solution_and_the_method(client, stored):
    path = f"/v1/solutions/{stored.solution_id}/citation"
    digest = client.get("/v1/solutions", params={"columns": "id,digest"}).json()["items"][0]["digest"]
    written = client.get(path)
    assert written.headers["content-type"].startswith("application/x-bibtex")
    assert written.text.startswith(f"@misc{{polhode-{stored.solution_id},")
    assert digest in written.text
    assert "Yehia" in written.text
    file = yaml.safe_load(client.get(path, params={"format": "cff"}).text)
    assert file["cff-version"] == "1.2.0"
    assert {each["value"] for each in file["identifiers"]} == {
        f"urn:uuid:{stored.solution_id}",
        f"sha256:{digest}",
    }
    assert file["title"] == title_of(client.get(f"/v1/solutions/{stored.solution_id}").json()["problem"])
    assert (
        client.get(path, headers={"Accept": "application/yaml"}).text == client.get(f"{path}?format=cff").text
    )


def test_a_citation_that_was_read_is_not_made_again(client, stored):
    path = f"/v1/solutions/{stored.solution_id}/citation"
    first = client.get(path)
    assert client.get(path, headers={"If-None-Match": first.headers["etag"]}).status_code == 304
    other = client.get(path, params={"format": "cff"})
    assert other.headers["etag"] != first.headers["etag"]


def test_what_cannot_be_cited_is_told(client, stored):
    assert client.get(f"/v1/solutions/{new_id()}/citation").status_code == 404
    assert (
        client.get(
            f"/v1/solutions/{stored.solution_id}/citation", headers={"Accept": "text/html"}
        ).status_code
        == 406
    )
    refused = client.get(f"/v1/solutions/{stored.solution_id}/citation", params={"format": "ris"})
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"] == "?format"


@pytest.mark.parametrize("text", ["a_1*g1^2 & 5%", "{}", "\\input{x}", "}\n@misc{x,"])
def test_no_title_breaks_out_of_its_field(text):
    """TeX's special characters are escaped, so that braces stay balanced and no command is read."""
    problem = {
        "body": {"A": 2, "C": 1},
        "motion": {"type": "planar"},
        "potential": {"type": "expression", "expression": text},
    }
    entry = bibtex(Cited(new_id(), "0" * 64, title_of(problem), date(2026, 1, 2), "1.0", 5))
    # The title has a line of its own, and as many braces as it has without the text.
    title = next(line for line in entry.splitlines() if line.startswith("  title"))
    bare = title.replace("\\textbackslash{}", "").replace("\\textasciicircum{}", "")
    bare = bare.replace("\\{", "").replace("\\}", "")
    assert bare.count("{") == bare.count("}") == 2
    assert title.endswith("}},")
    assert "\\input" not in title
    assert entry.count("@misc{polhode") == 1


@pytest.fixture
def sweep(client, jobs):
    sweep_id = client.post("/v1/sweeps", json=SWEEP).json()["id"]
    finish_sweep(jobs)
    return sweep_id


def opened(answer):
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/zip"
    return zipfile.ZipFile(io.BytesIO(answer.content))


def test_a_package_describes_the_files_that_are_in_it(client, sweep):
    file = opened(client.get(f"/v1/sweeps/{sweep}/package"))
    assert file.testzip() is None
    described = json.loads(file.read("datapackage.json"))
    assert {each["path"] for each in described["resources"]} == {"points.parquet", "sweep.json"}
    assert set(file.namelist()) == {"points.parquet", "sweep.json", "datapackage.json"}
    for each in described["resources"]:
        content = file.read(each["path"])
        assert each["bytes"] == len(content)
        assert each["hash"] == f"sha256:{hashlib.sha256(content).hexdigest()}"


def test_a_package_has_all_points_and_their_columns(client, sweep):
    file = opened(client.get(f"/v1/sweeps/{sweep}/package"))
    table = pq.read_table(io.BytesIO(file.read("points.parquet")))
    asked = client.get(f"/v1/sweeps/{sweep}/points", headers={"Accept": "application/vnd.apache.parquet"})
    assert table.equals(pq.read_table(io.BytesIO(asked.content)))
    assert table.num_rows == POINTS
    fields = json.loads(file.read("datapackage.json"))["resources"][0]["schema"]["fields"]
    assert [each["name"] for each in fields] == table.column_names
    assert {each["name"]: each["type"] for each in fields}["outcome"] == "string"
    assert {each["name"]: each.get("unit") for each in fields}["period"] == "the unit of time of the problem"


def test_the_document_in_a_package_is_the_sweep(client, sweep):
    file = opened(client.get(f"/v1/sweeps/{sweep}/package"))
    again = client.post("/v1/sweeps", json=json.loads(file.read("sweep.json")))
    assert again.status_code == 202, again.text
    documents = [client.get(f"/v1/sweeps/{each}").json()["document"] for each in (sweep, again.json()["id"])]
    assert documents[0] == documents[1]


def test_the_same_sweep_is_the_same_file(client, sweep):
    first = client.get(f"/v1/sweeps/{sweep}/package")
    assert client.get(f"/v1/sweeps/{sweep}/package").content == first.content
    known = client.get(f"/v1/sweeps/{sweep}/package", headers={"If-None-Match": first.headers["etag"]})
    assert (known.status_code, known.content) == (304, b"")
    assert client.head(f"/v1/sweeps/{sweep}/package").headers["etag"] == first.headers["etag"]


def test_a_sweep_that_goes_on_is_no_package_yet(client):
    sweep_id = client.post("/v1/sweeps", json=SWEEP).json()["id"]
    refused = client.get(f"/v1/sweeps/{sweep_id}/package")
    assert (refused.status_code, refused.json()["type"]) == (409, "urn:polhode:problem:not_finished")
