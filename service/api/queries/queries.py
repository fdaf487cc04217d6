"""Reads URL queries, with all faults at once, repeated parameters included; and the Prefer header."""

import re
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Generic, Literal, TypeVar, get_origin  # Any: JSON schemas

from fastapi import Depends, Header, Request
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError
from pydantic_core import ErrorDetails
from starlette.datastructures import QueryParams

from service.api.replies import invalid_request
from service.schemas.reading.documents import Fault
from service.schemas.reading.numbers import read_exact

MAX_WAIT_SECONDS = 60

Prefer = Annotated[
    str | None, Header(description="`wait=S`: wait up to S ≤ 60 seconds for the job to finish.")
]
"""The type of an endpoint's parameter that receives the header."""

PreferJob = Annotated[
    str | None,
    Header(
        alias="Prefer",
        description="`respond-async`: a job finds the answer, however fast it is. `wait=S`: if there is a"
        " job, wait up to S ≤ 60 seconds for it to finish.",
    ),
]
"""The same of an endpoint that answers by a job where it takes long."""

_WAIT = re.compile(r"(?:^|,)\s*wait\s*=\s*\"?(\d{1,9})\"?\s*(?=[,;]|$)", re.IGNORECASE | re.ASCII)

_ASYNC = re.compile(r"(?:^|,)\s*respond-async\s*(?=[,;]|$)", re.IGNORECASE | re.ASCII)


def wait_seconds(header: str | None) -> int | None:
    """Return the seconds to wait, capped, or None if the client does not wait.

    A preference that cannot be read is ignored, as the RFC says.
    """
    match = _WAIT.search(header or "")
    return None if match is None else min(int(match[1]), MAX_WAIT_SECONDS)


def wants_job(header: str | None) -> bool:
    """Tell whether the client prefers a job to an answer that it waits for."""
    return _ASYNC.search(header or "") is not None


FormatName = Literal["json", "ndjson", "csv", "npz", "arrow", "parquet"]
ListFormatName = Literal["json", "ndjson", "csv", "arrow", "parquet"]
FORMAT_HELP = "The format, whatever the Accept header says."


Schema = Mapping[str, Any]


class QueryModel(BaseModel):
    """The parameters of a query: independent fields, all of which may be left out.

    A list field may be given several times, any other once.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Query = TypeVar("Query", bound=QueryModel)


@dataclass(frozen=True, slots=True)
class Asked(Generic[Query]):
    """A query as far as it could be read."""

    parameters: Query
    """The parameters; faulty ones have their defaults."""
    sent: frozenset[str]
    """The names of all that were sent, good or bad."""
    faults: tuple[Fault, ...]


def query_of(model: type[Query]) -> Callable[[Request], Awaitable[Query]]:
    """Return the FastAPI dependency that reads a query, or refuses it with all its faults."""

    async def read(request: Request) -> Query:
        asked = read_query(request.query_params, model)
        refuse_if_any(asked.faults)
        return asked.parameters

    return read


def asked_of(model: type[Query]) -> Callable[[Request], Awaitable[Asked[Query]]]:
    """Return the dependency for endpoints that add further faults before they refuse."""

    async def read(request: Request) -> Asked[Query]:
        return read_query(request.query_params, model)

    return read


async def _refuse_all(request: Request) -> None:
    names = dict.fromkeys(request.query_params)
    refuse_if_any(
        [Fault(f"?{name}", "unknown_parameter", "no parameters are accepted here") for name in names]
    )


without_query = Depends(_refuse_all)
"""For endpoints without query parameters: refuses any."""


def read_query(given: QueryParams, model: type[Query]) -> Asked[Query]:
    """Return the readable parameters, and every fault: unknown, repeated and unreadable parameters."""
    faults: list[Fault] = []
    values: dict[str, str | list[str]] = {}
    for name in dict.fromkeys(given):
        sent = given.getlist(name)
        if name not in model.model_fields:
            accepted = ", ".join(model.model_fields)
            faults.append(Fault(f"?{name}", "unknown_parameter", f"accepted are {accepted}"))
        elif get_origin(model.model_fields[name].annotation) is list:
            values[name] = sent
        elif len(sent) > 1:
            message = f"given {len(sent)} times; once is accepted"
            faults.append(Fault(f"?{name}", "repeated_parameter", message))
        else:
            values[name] = sent[0]
    try:
        parameters = model.model_validate(values)
    except ValidationError as error:
        found = {str(details["loc"][0]): details for details in error.errors(include_url=False)}
        schemas = _schemas(model)
        faults += [_unreadable(name, values[name], details, schemas[name]) for name, details in found.items()]
        parameters = model.model_validate(
            {name: value for name, value in values.items() if name not in found}
        )
    return Asked(parameters, frozenset(given), tuple(faults))


def refuse_if_any(faults: Sequence[Fault]) -> None:
    """Raise the refusal of a query with ``faults``, if there are any."""
    if faults:
        raise invalid_request(faults)


def query_parameters(model: type[QueryModel], *needed: str) -> dict[str, Any]:
    """Return the OpenAPI extension of an endpoint with the query ``model``; it refuses without ``needed``."""
    return {
        "parameters": [
            {
                "name": name,
                "in": "query",
                "required": name in needed,
                **({"description": schema["description"]} if "description" in schema else {}),
                "schema": schema,
            }
            for name, schema in _schemas(model).items()
        ]
    }


def _schemas(model: type[QueryModel]) -> dict[str, Schema]:
    """Return the self-contained JSON schema of each parameter, without null, which a query cannot express."""
    document = model.model_json_schema()
    definitions = document.get("$defs", {})
    schemas: dict[str, Schema] = {}
    for name, given in document["properties"].items():
        schema = dict(given)
        for kind in schema.pop("anyOf", []):
            schema |= {} if kind.get("type") == "null" else kind
        if "$ref" in schema:
            definition = definitions[schema.pop("$ref").rpartition("/")[2]]
            schema = {**definition, **schema}
        if schema.get("default", ...) is None:
            del schema["default"]
        schemas[name] = schema
    return schemas


def _unreadable(name: str, value: str | list[str], details: ErrorDetails, schema: Schema) -> Fault:
    if details["type"] == "invalid_number":
        return Fault(f"?{name}", "invalid_number", details["msg"])
    shown = value if isinstance(value, str) else ", ".join(value)
    return Fault(f"?{name}", "invalid_value", f"{shown[:40]!r} is not accepted; {_accepted(schema)}")


def _accepted(schema: Schema) -> str:
    """Return the phrase that names the accepted values of a parameter."""
    if "enum" in schema:
        return f"accepted are {', '.join(map(str, schema['enum']))}"
    if "pattern" in schema and "examples" in schema:
        return f"accepted is text such as {' or '.join(schema['examples'])}"
    what = {"integer": "an integer", "number": "a number"}.get(schema.get("type", ""), "text")
    low, high = schema.get("minimum"), schema.get("maximum")
    if low is not None and high is not None:
        return f"accepted is {what} from {low:.10g} to {high:.10g}"
    return f"accepted is {what}" if low is None else f"accepted is {what} from {low:.10g} on"


def read_number(text: object) -> float:
    """Return the nearest double of a number that is read as in a document."""
    return float(read_exact(text))


Number = Annotated[float, BeforeValidator(read_number)]
"""A number written as in documents, also "17/10"; one outside a double's range is refused."""
