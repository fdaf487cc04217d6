"""JSON schemas of which fields are needed together: what the models themselves only check."""

from collections.abc import Mapping, Sequence
from typing import Any  # JSON schemas

from pydantic import ConfigDict

Schema = dict[str, Any]


def given(*names: str) -> Schema:
    """Return the schema of an object that has these fields, and null in none of them."""
    properties: Schema = {name: {"not": {"type": "null"}} for name in names}
    return {"type": "object", "required": list(names), "properties": properties}


def left_out(*names: str) -> Schema:
    """Return the schema of an object without these fields; null is as good."""
    properties: Schema = {name: {"type": "null"} for name in names}
    return {"properties": properties}


def within(name: str, schema: Mapping[str, Any]) -> Schema:
    """Return the schema of an object whose field is as ``schema`` says."""
    return {"properties": {name: dict(schema)}}


def one_of_each(*choices: Sequence[Schema]) -> ConfigDict:
    """Return the configuration of a model of which, for each choice, at least one schema holds.

    It is written with ``if``: generators of clients make models of every part of ``anyOf`` and ``allOf``.
    """
    whole: Schema = {"allOf": [{"anyOf": list(choice)} for choice in choices]}
    return ConfigDict(json_schema_extra={"if": whole, "then": True, "else": False})
