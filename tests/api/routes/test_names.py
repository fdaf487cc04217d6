"""Names of people in queries: lambda, A, a stand for the pointers to them."""

import pytest

from tests.support.api import PLANAR, STATE
from tests.support.sweeps import SWEEP, finish_sweep

pytestmark = pytest.mark.any_database

LAMBDA, PARAMETER, COEFFICIENT = "/motion/lambda", "/potential/parameters/a", "/potential/a"


@pytest.fixture
def jobs_made(client):
    """Planar motions with parameters a and b and their λ."""
    for number in ("3/4", 1, "3/2"):
        problem = {**PLANAR, "motion": {"type": "planar", "lambda": number}}
        assert client.post("/v1/jobs", json=problem).status_code == 202


def items(client, path, **query):
    answer = client.get(path, params=query)
    assert answer.status_code == 200, answer.json()
    return answer.json()["items"]


@pytest.mark.parametrize(
    ("named", "pointed"),
    [
        ({"where": "lambda>=1"}, {"where": f"{LAMBDA}>=1"}),
        ({"where": "A=2,a<0"}, {"where": f"/body/A=2,{PARAMETER}<0"}),
        ({"order": "-lambda"}, {"order": f"-{LAMBDA}"}),
        ({"columns": "id,lambda,b"}, {"columns": f"id,{LAMBDA},/potential/parameters/b"}),
    ],
)
def test_a_name_is_its_pointer(client, jobs_made, named, pointed):
    found = items(client, "/v1/jobs", **named)
    assert found == items(client, "/v1/jobs", **pointed)
    assert found


def test_pages_go_on_by_names(client, jobs_made):
    first = client.get("/v1/jobs?order=-lambda&limit=2").json()
    rest = client.get("/v1/jobs" + first["next"]).json()["items"]
    numbers = [item["problem"]["motion"]["lambda"] for item in [*first["items"], *rest]]
    assert numbers == ["3/2", 1, "3/4"]


def test_statistics_and_facets_take_names(client, jobs_made):
    named = client.get("/v1/jobs/statistics?of=lambda").json()["items"][0]
    assert (named["of"], named["min"], named["max"]) == (LAMBDA, 0.75, 1.5)
    assert client.get("/v1/jobs/facets?by=a").json()["facets"][0]["by"] == PARAMETER


def test_of_two_that_fit_the_refusal_lists_both(client, jobs_made):
    assert client.post("/v1/jobs", json=STATE).status_code == 202  # gravity, with the coefficients a and c
    refusal = client.get("/v1/jobs?where=a<0").json()
    assert [fault["code"] for fault in refusal["errors"]] == ["ambiguous_name"]
    assert all(each in refusal["detail"] for each in (PARAMETER, COEFFICIENT))
    # Of c there is the coefficient alone.
    assert items(client, "/v1/jobs", where="c<0") == items(client, "/v1/jobs", where="/potential/c<0") != []


def test_todays_names_win_and_unknown_ones_stay_unknown(client, stored):
    """A is a fact of solutions, and a slip is told with the fact that is near."""
    assert client.get("/v1/solutions?columns=A").json()["items"] == [{"A": 2.0}]
    refusal = client.get("/v1/solutions?where=perod<5").json()
    assert [fault["code"] for fault in refusal["errors"]] == ["unknown_column"]
    assert "did you mean 'period'?" in refusal["detail"]


def test_solutions_are_asked_by_the_table_of_numbers(client, stored):
    assert items(client, "/v1/solutions", where="c<0") == items(
        client, "/v1/solutions", where="/potential/c<0"
    )
    assert len(items(client, "/v1/solutions", where="a>0,c<0")) == 1


def test_points_of_a_sweep_are_asked_by_the_names_of_its_axes(client, jobs):
    place = f"/v1/sweeps/{client.post('/v1/sweeps', json=SWEEP).json()['id']}"
    finish_sweep(jobs)

    def points(**query):
        return items(client, f"{place}/points", **query)

    named = points(where="lambda<1,a<-1", order="-lambda", columns="index,lambda,a")
    assert named == points(
        where=f"{LAMBDA}<1,{PARAMETER}<-1", order=f"-{LAMBDA}", columns=f"index,{LAMBDA},{PARAMETER}"
    )
    assert named
    grid = client.get(f"{place}/grid?of=period&at=a=1").json()
    assert grid == client.get(f"{place}/grid?of=period&at={PARAMETER}=1").json()
    assert grid["at"][0]["pointer"] == PARAMETER


def test_two_axes_of_one_name_are_ambiguous(client):
    base = {**STATE, "time": {"stop": 1, "samples": 2}}
    axes = [{"pointer": f"/motion/omega/{k}", "values": [1, 2]} for k in (0, 1)]
    twice = {"base": base, "axes": [*axes, {"pointer": "/body/A", "values": [2]}], "keep": ["energy"]}
    place = f"/v1/sweeps/{client.post('/v1/sweeps', json=twice).json()['id']}"
    assert client.get(f"{place}/points?columns=A").status_code == 200
    grid = {
        "base": {**base, "motion": {**STATE["motion"], "gamma": ["3/5", 0, "4/5"]}},
        "axes": [
            {"pointer": "/motion/omega/0", "values": [1, 2]},
            {"pointer": "/motion/gamma/0", "values": ["3/5"]},
        ],
        "keep": ["energy"],
    }
    answer = client.post("/v1/sweeps", json=grid)
    place = f"/v1/sweeps/{answer.json()['id']}"
    refusal = client.get(f"{place}/points?where=0<1").json()
    assert [fault["code"] for fault in refusal["errors"]] == ["ambiguous_name"]
    assert "/motion/omega/0" in refusal["detail"]
    assert "/motion/gamma/0" in refusal["detail"]
