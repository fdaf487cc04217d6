"""Tables for people: columns of text, and the facts of a document."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

from service.escaping import one_line

_LONGEST = 100


def table(rows: Iterable[Iterable[object]]) -> str:
    """Return rows as lines with aligned columns."""
    cells = [[_cell(each) for each in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in cells)
    return "".join(f"{line.rstrip()}\n" for line in lines)


def facts_of(document: Mapping[str, object]) -> list[Sequence[object]]:
    """Return a row for each fact of a document; what is nested deeper is left to ``--json``."""
    return list(_facts(document))


def _facts(document: Mapping[str, object]) -> Iterator[Sequence[object]]:
    for name, value in document.items():
        match value:
            case {"value": number, "error": error, **others} if not others:
                yield name, f"{number} ± {error:.1e}" if isinstance(error, float) else f"{number} ± {error}"
            case {"value": digits, "radius": radius, **others} if not others:
                yield name, f"{digits} ± {radius}"
            case dict() if all(not isinstance(each, dict | list) for each in value.values()):
                yield name, _pairs(value)
            case dict() | list():
                continue
            case _:
                yield name, value


def _pairs(value: Mapping[str, object]) -> str | None:
    return ", ".join(f"{key}={each}" for key, each in value.items() if each is not None) or None


def _cell(value: object) -> str:
    if isinstance(value, dict):
        value = _pairs(value)
    if value is None:
        return "-"
    text = one_line(repr(value) if isinstance(value, float) else str(value))
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."
