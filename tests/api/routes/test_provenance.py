"""What a provenance tells is enough to make the solution again, and PROV-JSON holds together."""

import json
from datetime import datetime

import pytest

from service.jobs.records import Solved
from tests.support.api import PLANAR, solve_job
from tests.support.finishing import finish_success
from workers.computation.compute import solve_document

pytestmark = pytest.mark.any_database

RELATIONS = {
    "used": ("activity", "entity"),
    "wasGeneratedBy": ("entity", "activity"),
    "wasAssociatedWith": ("activity", "agent"),
}


@pytest.fixture
def lived(client, jobs):
    """A solution whose job lost a worker before."""
    assert client.post("/v1/jobs", json=PLANAR).status_code == 202
    lost = jobs.claim("host/one:7", lease_seconds=60.0)
    assert jobs.lose(lost, "its child died", max_attempts=3, retry_seconds=0.0)
    claim = jobs.claim("host/two:8", lease_seconds=60.0)
    outcome = solve_document(json.dumps(claim.problem))
    assert isinstance(outcome, Solved)
    assert finish_success(jobs, claim, outcome.summary, dense=outcome.dense, samples=outcome.samples)
    solution_id = client.get(f"/v1/jobs/{claim.job_id}").json()["solution"]
    return client.get(f"/v1/solutions/{solution_id}").json()


def provenance(client, solution):
    answer = client.get(f"/v1/solutions/{solution['id']}/provenance")
    assert answer.status_code == 200
    return answer.json()


def test_every_relation_is_between_things_that_are_told(client, lived):
    graph = provenance(client, lived)
    for relation, kinds in RELATIONS.items():
        assert graph[relation]
        for related in graph[relation].values():
            assert set(related) == {f"prov:{kind}" for kind in kinds}
            for kind in kinds:
                assert related[f"prov:{kind}"] in graph[kind]
    for related in graph["wasDerivedFrom"].values():
        assert {related["prov:generatedEntity"], related["prov:usedEntity"]} <= set(graph["entity"])
    names = [name for kind in ("entity", "activity", "agent") for name in graph[kind]]
    assert len(names) == len(set(names))
    assert {name.partition(":")[0] for name in names} == set(graph["prefix"])


def test_it_tells_each_attempt_its_worker_and_who_made_the_solution(client, lived):
    graph = provenance(client, lived)
    told = client.get(f"/v1/jobs/{lived['job']}/attempts").json()["items"]
    activities = [graph["activity"][f"polhode:job/{lived['job']}/attempt/{each['number']}"] for each in told]
    for attempt, activity in zip(told, activities, strict=True):
        assert activity["polhode:outcome"] == attempt["outcome"]
        assert datetime.fromisoformat(activity["prov:startTime"]) == datetime.fromisoformat(
            attempt["started_at"]
        )
        assert activity["prov:startTime"] <= activity["prov:endTime"]
    assert [each["polhode:outcome"] for each in activities] == ["lost", "succeeded"]
    assert activities[0]["polhode:reason"] == "its child died"
    (made,) = (
        each["prov:activity"]
        for each in graph["wasGeneratedBy"].values()
        if each["prov:entity"] == f"polhode:solution/{lived['id']}"
    )
    assert made.endswith("/attempt/2")
    workers = {
        graph["agent"][each["prov:agent"]]["prov:label"]
        for each in graph["wasAssociatedWith"].values()
        if each["prov:activity"] == made
    }
    assert "host/two:8" in workers
    assert "host/one:7" not in workers


def test_it_is_enough_to_make_the_solution_again(client, lived):
    """Here, where processor and libraries are those it names, with the same bits."""
    graph = provenance(client, lived)
    (problem,) = (each for each in graph["entity"].values() if each["prov:type"] == "polhode:Problem")
    again = solve_document(problem["prov:value"])
    made = json.loads(json.dumps(again.summary))
    assert {name: lived[name] for name in ("period", "energy", "error")} == {
        name: made[name] for name in ("period", "energy", "error")
    }
    (computation,) = (each for each in graph["activity"].values() if "polhode:numerics" in each)
    assert computation["polhode:processor"] == made["provenance"]["processor"]
    assert computation["polhode:numerics"] == made["provenance"]["numerics"]
    assert computation["polhode:threads"] == made["provenance"]["threads"]
    assert computation["polhode:compute_seconds"] == lived["cost"]["compute_seconds"]
    software = {each["prov:label"] for each in graph["agent"].values()}
    assert set(made["provenance"]["libraries"].split(", ")) <= software
    assert f"polhode {made['provenance']['version']}" in software


def test_a_planar_motion_has_its_examination_and_one_from_a_state_has_none(client, lived, jobs, stored):
    kinds = [
        {each["prov:type"] for each in provenance(client, solution)["activity"].values()}
        for solution in (lived, {"id": stored.solution_id})
    ]
    assert kinds == [{"polhode:Examination", "polhode:Computation"}, {"polhode:Computation"}]


def test_the_seconds_of_the_examination_are_those_of_the_job_that_computed_it(client, lived, jobs, stored):
    told = lived["cost"]["examination_seconds"]
    activities = provenance(client, lived)["activity"].values()
    (examination,) = (each for each in activities if each["prov:type"] == "polhode:Examination")
    assert examination["polhode:seconds"] == told > 0.0
    # A motion from a state needs none.
    state = client.get(f"/v1/solutions/{stored.solution_id}").json()
    assert state["cost"]["examination_seconds"] is None
    # Nor does the same problem at another tier, of which all is known.
    again = {**PLANAR, "accuracy": {"tier": "high"}}
    assert solve_job(client, jobs, again)["cost"]["examination_seconds"] < told


def test_what_there_is_not_has_none(client):
    assert client.get("/v1/solutions/none/provenance").status_code == 404
