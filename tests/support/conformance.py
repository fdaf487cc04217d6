"""What the OpenAPI document says of requests and answers, held against those that tests send and see."""

import json
import re
from collections.abc import Iterator, Mapping
from functools import cache

import jsonschema_rs

from service.api.openapi import openapi_text

PROBLEM = "application/problem+json"
JSON_TYPES = ("application/json", PROBLEM)
REFUSAL = {"$ref": "#/components/schemas/ProblemDetailsOut"}


@cache
def document() -> dict:
    return json.loads(openapi_text())


def nodes(node: object, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], dict]]:
    """Yield every object in a part of the document with its place."""
    if isinstance(node, dict):
        yield path, node
        for name, value in node.items():
            yield from nodes(value, (*path, name))
    elif isinstance(node, list):
        for index, value in enumerate(node):
            yield from nodes(value, (*path, str(index)))


def operations() -> Iterator[tuple[str, str, dict]]:
    """Yield path, method and description of every operation."""
    for path, methods in document()["paths"].items():
        for method, operation in methods.items():
            yield path, method.upper(), operation


@cache
def _closed_components() -> dict:
    """Return the components with every object closed: what is sent, is described."""
    components = json.loads(json.dumps(document()["components"]))
    for path, node in nodes(components["schemas"]):
        # What only asks whether some fields are there says nothing of the others.
        if "if" not in path and isinstance(node.get("properties"), dict) and node.get("type") == "object":
            node["additionalProperties"] = False
    return components


@cache
def _validator(schema: str) -> jsonschema_rs.Draft202012Validator:
    return jsonschema_rs.Draft202012Validator({**json.loads(schema), "components": _closed_components()})


def faults(schema: Mapping[str, object], instance: object) -> list[str]:
    """Return what is wrong with ``instance`` by a schema of the document, all objects closed."""
    found = _validator(json.dumps(schema, sort_keys=True)).iter_errors(instance)
    return [f"/{'/'.join(map(str, fault.instance_path))}: {fault.message[:300]}" for fault in found]


@cache
def _places() -> list[tuple[re.Pattern[str], dict]]:
    return [
        (re.compile(re.sub(r"\{\w+\}", "[^/]+", path)), methods)
        for path, methods in document()["paths"].items()
    ]


def _operation(method: str, path: str) -> dict | None:
    for pattern, methods in _places():
        if pattern.fullmatch(path):
            return methods.get(method.lower())
    return None


def check_exchange(request, response) -> None:
    """Fail unless the document describes a request that was accepted, and the answer whatever it is."""
    where = f"{request.method} {request.url.path} → {response.status_code}"
    media_type = response.headers.get("content-type", "").partition(";")[0]
    operation = _operation(request.method, request.url.path)
    if operation is None:  # what the document does not have can only be refused, or is the document itself
        schemas = {PROBLEM: REFUSAL} if response.is_error else {media_type: {}}
        if "text/html" in request.headers.get("accept", ""):
            schemas["text/html"] = {}  # people are shown a page where nothing is
    else:
        described = operation["responses"].get(str(response.status_code))
        assert described is not None, f"{where} is not described"
        if "content" not in described:
            assert not response.content, f"{where} has a body"
            return
        schemas = {name: content.get("schema", {}) for name, content in described["content"].items()}
    assert media_type in schemas, f"{where} is {media_type!r}, described are {sorted(schemas)}"
    if media_type in JSON_TYPES and response.is_stream_consumed and request.method != "HEAD":
        found = faults(schemas[media_type], response.json())
        assert not found, f"{where}: {found}"
    is_plain = request.headers.get("content-encoding", "").lower() not in ("gzip", "zstd")
    if operation is not None and "requestBody" in operation and response.is_success and is_plain:
        if not request.content:
            assert not operation["requestBody"]["required"], f"{where} without a body"
            return
        schema = operation["requestBody"]["content"]["application/json"]["schema"]
        answer = response.json() if media_type in JSON_TYPES else {}
        found = faults(schema, _accepted(json.loads(request.content.decode("utf-8-sig")), answer))
        assert not found, f"{where} although {found}"


def _accepted(sent: object, answer: dict) -> object:
    """Return what was sent, of a list only what was accepted."""
    if not isinstance(sent, list):
        return sent
    if "items" not in answer:  # an estimate names those that would be refused
        refused = {item["index"] for item in answer["refused"]}
        return [each for index, each in enumerate(sent) if index not in refused]
    return [each for each, item in zip(sent, answer["items"], strict=True) if item["status"] < 300]
