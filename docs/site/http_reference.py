"""The OpenAPI document as two pages: the resources, and the fields of the documents."""

import json
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

Document = dict[str, Any]
TITLES = {
    "health": "Is it well?",
    "status": "What it does now",
    "validations": "Judging potentials",
    "jobs": "Jobs",
    "solutions": "Solutions",
    "sweeps": "Sweeps",
    "families": "The catalogue",
    "accuracy": "Accuracy of the installation",
}


def http_page(api: Document) -> str:
    """Return the page of the resources: what each takes, and how it answers."""
    by_tag: dict[str, list[tuple[str, str, Document]]] = defaultdict(list)
    for path, operations in api["paths"].items():
        for method, operation in operations.items():
            by_tag[operation["tags"][0]].append((method.upper(), path, operation))
    lines = [
        "# HTTP, by resource",
        "",
        "Made from [openapi.json](../openapi.json), which programs read. What all resources keep to: "
        "[manners of HTTP](../http.md). Fields: [documents](documents.md).",
        "",
    ]
    for tag in sorted(by_tag, key=lambda tag: [*TITLES, tag].index(tag)):
        lines += [f"## {TITLES.get(tag, tag.capitalize())}", ""]
        for method, path, operation in by_tag[tag]:
            lines += [f"### {method} {path}", "", *_operation(operation), ""]
    return "\n".join(lines)


def _operation(operation: Document) -> Iterator[str]:
    yield operation.get("description") or operation["summary"]
    yield ""
    if parameters := operation.get("parameters"):
        yield from ("| parameter | in | |", "| --- | --- | --- |")
        for one in parameters:
            need = " (needed)" if one.get("required") else ""
            yield f"| `{one['name']}`{need} | {one['in']} | {_cell(one.get('description', ''))} |"
        yield ""
    for media, body in operation.get("requestBody", {}).get("content", {}).items():
        yield f"**Body** (`{media}`): {_kind(body.get('schema', {}))}"
        yield ""
        for name, example in list(body.get("examples", {}).items())[:1]:
            yield from (f"An example ({name.replace('_', ' ')}):", "", "```json")
            yield json.dumps(example["value"], indent=2, ensure_ascii=False)
            yield from ("```", "")
    yield from ("| status | answer | |", "| --- | --- | --- |")
    for status, answer in operation["responses"].items():
        content = answer.get("content", {})
        kinds = ", ".join(dict.fromkeys(_kind(body.get("schema", {})) for body in content.values()))
        media = ", ".join(f"`{media}`" for media in content)
        said = media if kinds in ("", "text", "anything") else kinds
        yield f"| {status} | {said} | {_cell(answer.get('description', ''))} |"


def documents_page(api: Document) -> str:
    """Return the page of the documents: every field with its kind and its meaning."""
    lines = [
        "# Documents, field by field",
        "",
        "What is sent ends in *In*, what is answered in *Out*. A number may be sent as a JSON number or as a "
        'string with an exact value (`"17/10"`).',
        "",
    ]
    for name, schema in sorted(api["components"]["schemas"].items()):
        lines += [f"## {name}", "", schema.get("description", ""), ""]
        needed = set(schema.get("required", ()))
        if fields := schema.get("properties"):
            lines += ["| field | kind | |", "| --- | --- | --- |"]
            for field, kind in fields.items():
                star = " (needed)" if field in needed and name.endswith("In") else ""
                lines.append(
                    f"| `{field}`{star} | {_kind(kind, here=True)} | {_cell(kind.get('description', ''))} |"
                )
            lines.append("")
    return "\n".join(lines)


def _kind(schema: Document, *, here: bool = False) -> str:
    page = "" if here else "documents.md"
    if reference := schema.get("$ref"):
        name = reference.rpartition("/")[2]
        return f"[{name}]({page}#{name.lower()})"
    for several in ("anyOf", "oneOf", "allOf"):
        if several in schema:
            return " or ".join(dict.fromkeys(_kind(one, here=here) for one in schema[several]))
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return ", ".join(f"`{json.dumps(value)}`" for value in schema["enum"])
    if schema.get("type") == "array":
        return f"list of {_kind(schema.get('items', {}), here=here)}"
    if schema.get("type") == "object":
        values = schema.get("additionalProperties")
        return f"object of {_kind(values, here=here)}" if isinstance(values, dict) and values else "object"
    words = {"string": "text", "integer": "whole number", "number": "number", "boolean": "true or false"}
    kind = schema.get("type")
    if isinstance(kind, list):
        return " or ".join(words.get(str(one), str(one)) for one in kind)
    return words.get(kind or "", kind or "anything")


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
