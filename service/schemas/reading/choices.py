"""Unions of document types: finds the member that a client means, or reports what is accepted.

Pydantic's own unions either report the faults of every member, or do not say
what would have been accepted.
"""

from collections.abc import Callable, Mapping, Sequence

from pydantic import BaseModel, ConfigDict

from service.schemas.reading.numbers import refuse

TAG_MARK = "<>"
"""Prefix of the tags of union members, which distinguishes them from fields in an error's path."""


class WireModel(BaseModel):
    """The base class of all request models: unknown fields are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True)


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
