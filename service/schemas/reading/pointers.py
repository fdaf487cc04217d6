"""JSON pointers (RFC 6901): reads and replaces values inside documents."""

from collections.abc import Mapping, Sequence


class NoSuchPlaceError(LookupError):
    """A pointer to nothing; the message names the longest existing part and its content."""


def split_pointer(pointer: str) -> tuple[str, ...]:
    """Return the parts of a pointer; raises :class:`NoSuchPlaceError` if it is none."""
    if not pointer.startswith("/"):
        raise NoSuchPlaceError("a JSON pointer begins with /, such as /motion/lambda")
    return tuple(part.replace("~1", "/").replace("~0", "~") for part in pointer[1:].split("/"))


def value_at(document: object, path: Sequence[str]) -> object:
    """Return what is at ``path``; raises :class:`NoSuchPlaceError`."""
    for depth, part in enumerate(path):
        match document:
            case dict() if part in document:
                document = document[part]
            case list() if _is_index(part) and int(part) < len(document):
                document = document[int(part)]
            case _:
                where = "/" + "/".join(path[:depth])
                raise NoSuchPlaceError(f"there is no {part[:40]!r} in {where}, {_what_is_in(document)}")
    return document


def with_values(document: object, values: Mapping[tuple[str, ...], object]) -> object:
    """Return a copy of ``document`` with ``values`` at existing places; the rest is shared."""
    below: dict[str, dict[tuple[str, ...], object]] = {}
    for path, value in values.items():
        if not path:
            return value
        below.setdefault(path[0], {})[path[1:]] = value
    if isinstance(document, dict):
        return {**document, **{part: with_values(document[part], rest) for part, rest in below.items()}}
    if isinstance(document, list):
        items = list(document)
        for part, rest in below.items():
            items[int(part)] = with_values(items[int(part)], rest)
        return items
    return document


def _is_index(part: str) -> bool:
    return part == "0" or (part.isascii() and part.isdigit() and not part.startswith("0") and len(part) < 10)


def _what_is_in(document: object) -> str:
    match document:
        case dict():
            return f"which has {', '.join(map(str, list(document)[:20])) or 'no fields'}"
        case list():
            return f"a list of {len(document)}"
    return "which has no parts"
