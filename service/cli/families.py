"""``polhode families``: the catalogue of families and cases, for people."""

import json
from collections.abc import Iterator, Mapping
from typing import Annotated

import typer

from service.cli.common import REFUSED, AsJson, fail
from service.terminal import answer

_WIDTH = 28


def families(
    name: Annotated[
        str | None, typer.Argument(help="a family or a case; all in one line each if left out")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the families of potentials and the cases, or tell all of one, with a problem that runs."""
    rows = list(_rows())
    if name is None:
        if as_json:
            answer(json.dumps([row for _, row in rows]) + "\n")
            return
        answer("".join(f"{key:<{_WIDTH}}{_line(row)}\n" for key, row in rows))
        return
    found = [row for key, row in rows if key == name]
    if not found:
        fail(
            f"there is no family and no case {name!r}; there are {', '.join(key for key, _ in rows)}", REFUSED
        )
    answer(json.dumps(found[0]) + "\n" if as_json else "".join(f"{line}\n" for line in _all_of(found[0])))


def _rows() -> Iterator[tuple[str, Mapping[str, object]]]:
    from service import catalogue  # noqa: PLC0415

    for family in catalogue.families():
        yield family.type, family.model_dump()
    for named in catalogue.cases():
        # Two words name a potential here and a motion below: the motion has the plain one.
        key = named.name if named.name not in _CLASSICAL else f"{named.name}-potential"
        yield key, named.model_dump()
    for case in catalogue.classical():
        yield case.case, case.model_dump()


_CLASSICAL = ("chaplygin",)


def _line(row: Mapping[str, object]) -> str:
    year = row.get("year")
    return f"{row['title']}{f', {year}' if year else ''}"


def _all_of(row: Mapping[str, object]) -> Iterator[str]:
    for field, content in row.items():
        if field == "example":
            continue
        parts = [f"{k}: {v}" for k, v in content.items()] if isinstance(content, dict) else content
        lines = parts if isinstance(parts, list) else ["not known" if parts is None else str(parts)]
        for number, line in enumerate(lines):
            yield f"{field if number == 0 else '':<14}{line}"
    if row["example"] is not None:
        yield "example"
        yield json.dumps(row["example"], indent=2)
