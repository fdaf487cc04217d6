"""Models of documents, read part by part, so that a fault in one part does not hide those in another.

Unions find the member that a client means, or report what is accepted: pydantic's own either report the
faults of every member, or do not say what would have been accepted. A document that pydantic refuses as a
whole is read part by part, and the readable parts are still checked against the rules of the domain.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from inspect import get_annotations
from typing import Any, TypeVar  # Any: JSON schemas and documents

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from service.schemas.reading.documents import MAX_FAULTS, Document, Fault, pointer_to
from service.schemas.reading.numbers import refuse

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


TAG_MARK = "<>"
"""Prefix of the tags of union members, which distinguishes them from fields in an error's path."""


class WireModel(BaseModel):
    """The base class of all request models: unknown fields are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True)


class Section(WireModel, ABC):
    """A part of a document that has a canonical document: equal parts have equal ones."""

    @abstractmethod
    def canonical(self) -> Document:
        """Return the canonical document."""


def require_kind(
    kinds: Sequence[str], *, models: Mapping[str, type[BaseModel]]
) -> Callable[[object], object]:
    """Return a validator that refuses objects whose ``type`` is none of ``kinds``."""
    accepted = f"accepted are {', '.join(kinds)}"

    def check(value: object) -> object:
        if isinstance(value, tuple(models.values())):
            return value
        if not isinstance(value, dict):
            raise refuse("invalid_type", f'an object with "type" is expected; {accepted}')
        if "type" not in value:
            raise refuse("missing_field", f'"type" is missing; {accepted}', below="type")
        kind = value["type"]
        if not isinstance(kind, str) or kind not in kinds:
            raise refuse("invalid_value", f"{str(kind)[:40]!r} is not a type; {accepted}", below="type")
        return value

    return check


def tag_by_type(value: object) -> str | None:
    """Return the tag of the union member that ``type`` names."""
    kind = value.get("type") if isinstance(value, dict) else getattr(value, "type", None)
    return f"{TAG_MARK}{kind}"


def tag_by_field(choices: Sequence[str], default: str) -> Callable[[object], str]:
    """Return a discriminator by which of the fields ``choices`` is given."""

    def tag(value: object) -> str:
        for name in choices:
            if (name in value) if isinstance(value, dict) else hasattr(value, name):
                return TAG_MARK + name
        return TAG_MARK + default

    return tag


def require_one(
    names: Sequence[str], *, models: tuple[type[BaseModel], ...], accepted: str, may_be_none: bool
) -> Callable[[object], object]:
    """Return a validator that refuses objects with more than one of the fields ``names``, or with none.

    With ``may_be_none``, the union's default member reports a missing field itself.
    """

    def check(value: object) -> object:
        if isinstance(value, models):
            return value
        given = [name for name in names if isinstance(value, dict) and name in value]
        if not isinstance(value, dict) or not (given or may_be_none):
            raise refuse("invalid_type", f"an object is expected; {accepted}")
        if len(given) > 1:
            raise refuse("conflicting_fields", f"{' and '.join(given)} exclude each other; {accepted}")
        return value

    return check


Model = TypeVar("Model", bound=BaseModel)

_CODES = {
    "missing": "missing_field",
    "extra_forbidden": "unknown_field",
    "literal_error": "invalid_value",
    "too_short": "invalid_length",
    "too_long": "invalid_length",
    "string_too_long": "invalid_length",
}
"""Our error codes for pydantic's; errors about types are ``invalid_type``."""

_OF_KEY = "[key]"
"""The part that pydantic adds to the location of a key that is refused."""

_EXPECTED = {
    "model_type": "an object",
    "model_attributes_type": "an object",
    "dict_type": "an object",
    "list_type": "a list",
    "string_type": "a string",
    "bool_type": "true or false",
}


def read_parts(
    document: object, model: type[Model], members: Mapping[str, type[BaseModel]]
) -> tuple[Document, list[Fault]]:
    """Return the parts of ``document`` that could be read, and the faults of the others.

    Fields that were left out have their defaults. ``members`` are the classes of the unions in
    ``model``, by their tags without the prefix.
    """
    if not isinstance(document, dict):
        accepted = ", ".join(model.model_fields)
        return {}, [Fault("", "invalid_type", f"an object is expected, with the fields {accepted}")]
    try:
        whole = model.model_validate(document)
    except ValidationError as error:
        found = error.errors(include_url=False, include_input=False)
        faults = [_fault(details, model, members) for details in found[: MAX_FAULTS + 1]]
        bad = {str(details["loc"][0]) for details in found if details["loc"]}
        return {
            name: read_part(model, name, document) for name in model.model_fields if name not in bad
        }, faults
    return {name: getattr(whole, name) for name in model.model_fields}, []


def read_part(model: type[BaseModel], name: str, document: Document) -> object:
    """Return one part of ``document``, its default if it was left out; raises pydantic's ValidationError."""
    if name not in document:
        return model.model_fields[name].get_default(call_default_factory=True, validated_data={})
    return _adapter(model, name).validate_python(document[name])


def fields_of(model: BaseModel) -> dict[str, Any]:
    """Return the fields of a model as a document has them, with numbers as they were read."""
    fields = ((field.alias or name, getattr(model, name)) for name, field in type(model).model_fields.items())
    return {name: fields_of(value) if isinstance(value, BaseModel) else value for name, value in fields}


@cache
def _adapter(model: type[BaseModel], name: str) -> TypeAdapter[object]:
    # Pydantic keeps the validators of an Annotated field apart from its type.
    stated = next(found for base in model.__mro__ if name in (found := get_annotations(base)))
    return TypeAdapter(stated[name])


def _fault(details: ErrorDetails, model: type[BaseModel], members: Mapping[str, type[BaseModel]]) -> Fault:
    kind, path, owner = details["type"], list[str | int](), model
    for part in details["loc"]:
        if part == _OF_KEY:  # the key itself is told by the part before
            continue
        if isinstance(part, str) and part.startswith(TAG_MARK):
            owner = members.get(part.removeprefix(TAG_MARK), owner)
            continue
        path.append(part)
        owner = _nested(owner, part)
    context = details.get("ctx", {})
    if below := context.get("below"):
        path.append(below)
    return Fault(pointer_to(path), _CODES.get(kind, _other_code(kind)), _message(details, path, owner))


def _nested(owner: type[BaseModel], field: str | int) -> type[BaseModel]:
    annotation = owner.model_fields[field].annotation if field in owner.model_fields else None
    return annotation if isinstance(annotation, type) and issubclass(annotation, BaseModel) else owner


def _other_code(kind: str) -> str:
    is_builtin_type_error = kind.endswith(("_type", "_attributes_type"))
    return "invalid_type" if is_builtin_type_error else kind


def _message(details: ErrorDetails, path: Sequence[str | int], owner: type[BaseModel]) -> str:
    if details["type"] == "extra_forbidden":
        names = ", ".join(field.alias or name for name, field in owner.model_fields.items())
        return f"{str(path[-1])[:40]!r} is not a field here; accepted are {names}"
    if details["type"] == "missing":
        return f'"{path[-1]}" is missing'
    if details["type"] in ("too_short", "too_long"):
        limits = details["ctx"]
        if "max_length" in limits:
            return f"too many items; at most {limits['max_length']} are accepted"
        return f"too few items; at least {limits['min_length']} are needed"
    if details["type"] in _EXPECTED:
        return f"{_EXPECTED[details['type']]} is expected"
    return details["msg"].replace("Input should be", "accepted are", 1)
