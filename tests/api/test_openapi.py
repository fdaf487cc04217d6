"""Laws of the OpenAPI document: what people, generators of clients and strict readers need of it."""

import pytest

from service.api.descriptions import UNLINKED, recorded
from service.api.replies import TITLES
from tests.support.conformance import document, faults, nodes, operations

OPERATIONS = {
    "/livez": {"GET": "get_liveness"},
    "/readyz": {"GET": "get_readiness"},
    "/metrics": {"GET": "get_metrics"},
    "/v1/accuracy": {"GET": "get_accuracy"},
    "/v1/atlases": {"GET": "list_atlases", "POST": "draw_atlas"},
    "/v1/atlases/{atlas_id}": {"GET": "get_atlas"},
    "/v1/events": {"GET": "follow_installation"},
    "/v1/families": {"GET": "list_families"},
    "/v1/jobs": {"GET": "list_jobs", "POST": "submit_job"},
    "/v1/jobs/facets": {"GET": "get_job_facets"},
    "/v1/jobs/statistics": {"GET": "get_job_statistics"},
    "/v1/jobs/{job_id}": {"GET": "get_job", "PATCH": "change_job", "DELETE": "delete_job"},
    "/v1/jobs/{job_id}/attempts": {"GET": "get_attempts"},
    "/v1/jobs/{job_id}/cancel": {"POST": "cancel_job"},
    "/v1/jobs/{job_id}/events": {"GET": "follow_job"},
    "/v1/jobs/{job_id}/result": {"GET": "get_result"},
    "/v1/integrals": {"POST": "judge_integral"},
    "/v1/integrals/searches": {"POST": "search_integrals"},
    "/v1/potentials/searches": {"POST": "search_potentials"},
    "/v1/searches": {"POST": "search_numbers"},
    "/v1/problems/{digest}/solutions": {"GET": "list_problem_solutions"},
    "/v1/status": {"GET": "get_status"},
    "/v1/sweeps/{sweep_id}/jobs": {"GET": "list_sweep_jobs"},
    "/v1/solutions": {"GET": "list_solutions"},
    "/v1/solutions/facets": {"GET": "get_solution_facets"},
    "/v1/solutions/statistics": {"GET": "get_solution_statistics"},
    "/v1/solutions/{solution_id}": {
        "GET": "get_solution",
        "PATCH": "change_solution",
        "DELETE": "delete_solution",
    },
    "/v1/solutions/{solution_id}/audits": {"GET": "list_audits", "POST": "audit_solution"},
    "/v1/solutions/{solution_id}/audits/{audit_id}": {"GET": "get_audit"},
    "/v1/solutions/{solution_id}/citation": {"GET": "get_citation"},
    "/v1/solutions/{solution_id}/enclosures": {"GET": "get_enclosures"},
    "/v1/solutions/{solution_id}/provenance": {"GET": "get_provenance"},
    "/v1/solutions/{solution_id}/function": {"GET": "get_function"},
    "/v1/solutions/{solution_id}/trajectory": {"GET": "get_trajectory"},
    "/v1/sweeps": {"GET": "list_sweeps", "POST": "submit_sweep"},
    "/v1/sweeps/{sweep_id}": {"GET": "get_sweep", "PATCH": "change_sweep", "DELETE": "delete_sweep"},
    "/v1/sweeps/{sweep_id}/cancel": {"POST": "cancel_sweep"},
    "/v1/sweeps/{sweep_id}/package": {"GET": "get_package"},
    "/v1/sweeps/{sweep_id}/events": {"GET": "follow_sweep"},
    "/v1/sweeps/{sweep_id}/grid": {"GET": "get_grid"},
    "/v1/sweeps/{sweep_id}/provenance": {"GET": "get_sweep_provenance"},
    "/v1/sweeps/{sweep_id}/points": {"GET": "get_points"},
    "/v1/sweeps/{sweep_id}/points/facets": {"GET": "get_point_facets"},
    "/v1/sweeps/{sweep_id}/points/statistics": {"GET": "get_point_statistics"},
    "/v1/validations": {"POST": "validate"},
}
"""Clients are generated with these names: a new one is added, none is changed."""

SCHEMAS = "#/components/schemas/"


def schemas() -> dict[str, dict]:
    return document()["components"]["schemas"]


def reached(start: object) -> set[str]:
    """Return the names of the components that a part of the document leads to."""
    found: set[str] = set()
    waiting = [start]
    while waiting:
        for _, node in nodes(waiting.pop()):
            reference = str(node.get("$ref", ""))
            name = reference.removeprefix(SCHEMAS) if reference.startswith(SCHEMAS) else ""
            if name and name not in found:
                found.add(name)
                waiting.append(schemas()[name])
    return found


def of_requests() -> set[str]:
    return reached([operation.get("requestBody") for _, _, operation in operations()])


def of_answers() -> set[str]:
    return reached([operation["responses"] for _, _, operation in operations()])


def test_operations_have_short_stable_names():
    found: dict[str, dict[str, str]] = {}
    for path, method, operation in operations():
        found.setdefault(path, {})[method] = operation["operationId"]
    assert found == OPERATIONS
    names = [name for methods in found.values() for name in methods.values()]
    assert len(names) == len(set(names))


def test_everything_is_described_in_words():
    missing = [
        f"{name}.{field}"
        for name, schema in schemas().items()
        for field, described in schema.get("properties", {}).items()
        if not described.get("description", "").endswith(".")
    ]
    missing += [name for name, schema in schemas().items() if not schema.get("description")]
    for path, method, operation in operations():
        if not operation.get("description"):
            missing.append(f"{method} {path}")
        for parameter in operation.get("parameters", []):
            if not parameter.get("description", "").endswith("."):
                missing.append(f"{method} {path} {parameter['name']}")
    assert missing == []


def test_defaults_are_plain_values():
    # Generators of clients give up an operation if a field anywhere in its body has an object for a default.
    objects = [path for path, node in nodes(document()) if isinstance(node.get("default"), dict)]
    assert objects == []


def test_every_integer_of_a_query_has_bounds_that_a_database_can_count_to():
    found = {
        (path, parameter["name"]): (parameter["schema"].get("minimum"), parameter["schema"].get("maximum"))
        for path, _, operation in operations()
        for parameter in operation.get("parameters", [])
        if parameter["in"] == "query" and parameter["schema"].get("type") == "integer"
    }
    assert ("/v1/sweeps/{sweep_id}/points", "offset") in found
    without = [place for place, (low, high) in found.items() if low is None or high is None]
    assert without == []
    assert all(-(2**31) <= low <= high < 2**31 for low, high in found.values())


def test_headers_that_openapi_describes_by_other_means_are_no_parameters():
    declared = {
        parameter["name"].lower()
        for _, _, operation in operations()
        for parameter in operation.get("parameters", [])
        if parameter["in"] == "header"
    }
    assert not declared & {"accept", "content-type", "authorization"}


def test_requests_refuse_unknown_fields_and_answers_may_have_more():
    assert not of_requests() & of_answers()
    assert reached(document()["paths"]) == set(schemas())
    for name in of_requests():
        assert schemas()[name]["additionalProperties"] is False, name
    for name in of_answers():
        # The object itself; its maps from names to values have schemas for these.
        closed = [path for path, node in nodes(schemas()[name]) if node.get("additionalProperties") is False]
        assert closed == [], name


def example_value(example: dict) -> object:
    if "$ref" in example:
        return document()["components"]["examples"][example["$ref"].rpartition("/")[2]]["value"]
    return example["value"]


def examples():
    """Yield every example in the document with its place and schema."""
    for path, node in nodes(document()):
        given = node.get("examples")
        if isinstance(given, list):
            yield from ((path, node, example) for example in given)
        elif isinstance(given, dict) and "schema" in node:
            yield from ((path, node["schema"], example_value(example)) for example in given.values())
        if "default" in node and "title" in node:
            yield path, node, node["default"]


def test_every_example_and_default_is_as_its_schema_says():
    found = list(examples())
    assert len(found) > 20
    for path, schema, example in found:
        assert faults(schema, example) == [], path


TEXT = ("application/json", "application/problem+json", "application/x-ndjson", "text/csv", "text/plain")
"""What an example can show; the others are files for programs, and pictures."""


def test_every_request_and_every_answer_has_an_example():
    missing = [
        (*where, media_type)
        for path, method, operation in operations()
        for where, holder in [
            ((method, path, "request"), operation.get("requestBody", {})),
            *(((method, path, status), answer) for status, answer in operation["responses"].items()),
        ]
        for media_type, content in holder.get("content", {}).items()
        if media_type in TEXT and not content.get("examples")
    ]
    assert missing == []


def test_recorded_examples_belong_to_operations_and_name_no_machine():
    assert set(recorded()) <= {operation["operationId"] for _, _, operation in operations()}
    hosts = {str(node["host"]) for _, node in nodes(recorded()) if "host" in node}
    workers = {str(node["worker"]) for _, node in nodes(recorded()) if "worker" in node} - {"ok"}
    assert hosts
    assert workers
    assert {name.partition("/")[0] for name in hosts | workers} == {"laptop"}


def test_links_lead_to_operations_with_the_parameter_that_they_give():
    parameters = {
        operation["operationId"]: {each["name"] for each in operation.get("parameters", [])}
        for _, _, operation in operations()
    }
    found = [
        (operation["operationId"], link)
        for _, _, operation in operations()
        for answer in operation["responses"].values()
        for link in answer.get("links", {}).values()
    ]
    assert all(set(link["parameters"]) <= parameters[link["operationId"]] for _, link in found)
    reached = {link["operationId"] for _, link in found}
    with_ids = {name for name, given in parameters.items() if given & {"job_id", "solution_id", "sweep_id"}}
    assert reached == with_ids - set(UNLINKED)


def test_links_are_answered(client, stored):
    """Each link of an answer that is here leads to an answer too."""
    answers = {"get_job": f"/v1/jobs/{stored.job.id}", "get_solution": f"/v1/solutions/{stored.solution_id}"}
    places = {operation["operationId"]: (path, method, operation) for path, method, operation in operations()}
    followed = 0
    for name, path in answers.items():
        answer = client.get(path).json()
        for link in places[name][2]["responses"]["200"]["links"].values():
            target, method, _ = places[link["operationId"]]
            ((parameter, expression),) = link["parameters"].items()
            value = answer[expression.removeprefix("$response.body#/")]
            if method == "GET":
                there = client.get(target.replace(f"{{{parameter}}}", value))
                assert there.status_code == 200 or there.json()["type"].endswith("no_enclosures")
                followed += 1
    assert followed > 5


def alternatives(schema: dict) -> list[dict]:
    return schema.get("anyOf", [schema])


def test_examples_of_integers_are_integers():
    integers = [
        (path, node)
        for path, node in nodes(schemas())
        if any(each.get("type") == "integer" for each in alternatives(node))
    ]
    texts = [
        example
        for _, node in integers
        for each in alternatives(node)
        if each.get("type") == "string"
        for example in each.get("examples", ())
    ]
    assert texts
    assert [text for text in texts if not text.isdecimal()] == []


@pytest.mark.parametrize(
    ("text", "accepted"),
    [
        ("17/10", True),
        ("-1e-12", True),
        (" .5 ", True),
        ("1.", True),
        ("1/2.5", False),
        ("one", False),
        ("", False),
    ],
)
def test_numbers_as_text_have_the_pattern_of_those_that_are_read(text, accepted):
    document = {"tolerance": text}
    assert (faults({"$ref": f"{SCHEMAS}ToleranceIn"}, document) == []) == accepted


def test_the_answer_to_a_list_of_which_nothing_is_accepted_is_described():
    assert {"errors", "items", "request_id"} <= set(schemas()["ProblemDetailsOut"]["properties"])
    assert "no_problem_accepted" in TITLES
    item = {"status": 422, "job": None, "problem": {"type": "t", "title": "t", "status": 422, "detail": "d"}}
    whole = {"type": "t", "title": "t", "status": 422, "detail": "d", "items": [item]}
    assert faults({"$ref": f"{SCHEMAS}ProblemDetailsOut"}, whole) == []
    item["problem"]["unheard_of"] = 1
    assert len(faults({"$ref": f"{SCHEMAS}ProblemDetailsOut"}, whole)) == 1
