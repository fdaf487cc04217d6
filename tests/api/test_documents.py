import json
import subprocess
import sys
from pathlib import Path

import pytest

from service.api.descriptions import describe
from service.api.replies import TITLES
from service.dynamics.errors import DynamicsError
from service.schemas.problem.documents import JobIn
from service.schemas.problem.problem import check_problem, read_question
from service.settings import Settings
from tests.support.api import TestClient, create_app

pytestmark = pytest.mark.any_database

TOP = Path(__file__).parents[2]


def references(node):
    if isinstance(node, dict):
        yield from ([node["$ref"]] if isinstance(node.get("$ref"), str) else [])
        for value in node.values():
            yield from references(value)
    elif isinstance(node, list):
        for value in node:
            yield from references(value)


NOT_JSON = {
    "/metrics": "text/plain",
    "/v1/solutions/{solution_id}/citation": "application/x-bibtex",
    "/v1/sweeps/{sweep_id}/package": "application/zip",
}
"""What these answer in the first place."""


def test_the_committed_openapi_document_is_that_of_the_app(client):
    committed = json.loads((TOP / "docs" / "openapi.json").read_text(encoding="utf-8"))
    assert client.get("/openapi.json").json() == committed


def test_every_reference_in_it_leads_somewhere(app):
    document = app.openapi()
    found = set(references(document))
    assert found
    for reference in found:
        root, components, kind, name = reference.split("/")
        assert (root, components) == ("#", "components")
        assert name in document["components"][kind]


def test_every_operation_names_its_refusals_as_problem_documents(app):
    for path, operations in app.openapi()["paths"].items():
        for operation in operations.values():
            for status, response in operation["responses"].items():
                if status in ("204", "304"):
                    assert "content" not in response
                    continue
                kinds = set(response.get("content", {}))
                expected = NOT_JSON.get(path, "application/json")
                expected = "text/event-stream" if path.endswith("/events") else expected
                expected = "application/problem+json" if status >= "400" else expected
                assert expected in kinds, (path, status)


def read_job(document):
    return check_problem(document, JobIn)


def test_the_examples_of_bodies_are_accepted(app):
    paths = app.openapi()["paths"]
    for path, reader in (("/v1/jobs", read_job), ("/v1/validations", read_question)):
        examples = paths[path]["post"]["requestBody"]["content"]["application/json"]["examples"]
        for example in examples.values():
            reader(example["value"])


ABSENT = {"ReadinessOut": {"compiling", "cluster"}}
"""Fields that are absent where there is nothing to tell."""


def test_answers_have_no_defaults(app):
    document = app.openapi()
    answers = {
        content["schema"]["$ref"].rpartition("/")[2]
        for path in document["paths"].values()
        for operation in path.values()
        for status, response in operation["responses"].items()
        if status.startswith("2")
        for content in response.get("content", {}).values()
        if "$ref" in content.get("schema", {})
    }
    assert {"JobOut", "SolutionOut", "VerdictOut"} <= answers
    for name in answers:
        schema = document["components"]["schemas"][name]
        assert set(schema["required"]) | ABSENT.get(name, set()) == set(schema["properties"]), name


def test_the_examples_of_families_are_accepted_as_jobs(client):
    catalogue = client.get("/v1/families").json()
    families, cases = catalogue["items"], catalogue["cases"]
    kinds = {"expression", "gravity", "rational", "homogeneous", "general"}
    assert {family["type"] for family in families} == kinds
    for family in families:
        assert family["example"]["potential"]["type"] == family["type"]
    for case in cases:
        assert case["example"]["potential"]["type"] == case["family"]
    for item in (*families, *cases):
        response = client.post("/v1/jobs", json=item["example"])
        assert response.status_code == 202, response.json()


def subclasses(cause):
    for subclass in cause.__subclasses__():
        yield subclass
        yield from subclasses(subclass)


def test_every_code_is_documented():
    text = (TOP / "docs" / "errors.md").read_text(encoding="utf-8")
    codes = set(TITLES) | {
        cause.code for cause in subclasses(DynamicsError) if cause.__module__.startswith("service")
    }
    assert [code for code in sorted(codes) if f"`{code}`" not in text] == []


def test_an_app_that_lives_is_ready(client):
    assert client.get("/livez").json() == {"status": "ok", "checks": {}}
    assert client.get("/readyz").json() == {
        "status": "ok",
        "checks": {"database": "ok", "sandbox": "ok"},
        "workers": "none",
    }


def test_without_tables_it_lives_and_is_not_ready(tmp_path):
    settings = Settings(database_url=f"sqlite:///{tmp_path / 'empty.db'}")
    with TestClient(create_app(settings)) as client:
        assert client.get("/livez").status_code == 200
        response = client.get("/readyz")
    assert response.status_code == 503
    assert response.json()["type"] == "urn:polhode:problem:not_ready"
    assert "polhode migrate" in response.json()["checks"]["database"]


def test_the_app_starts_without_what_only_workers_need():
    needless = {"sympy", "heyoka", "matplotlib", "workers"}
    program = f"import sys, service.app; print(*({needless} & set(sys.modules)))"
    ran = subprocess.run([sys.executable, "-c", program], cwd=TOP, capture_output=True, text=True, check=True)
    assert ran.stdout.split() == []


def test_the_description_does_not_depend_on_the_lifespan(app):
    assert describe(app) == app.openapi()
