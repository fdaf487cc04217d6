"""Stored resources that match a query: read page by page, by cursors, as they are needed."""

from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from itertools import islice
from types import ModuleType
from typing import TYPE_CHECKING, Generic, TypeVar
from urllib.parse import urlencode, urljoin

from polhode.documents.problems import Document
from polhode.documents.quantities import items
from polhode.drawing import rows_html
from polhode.errors import PolhodeError
from polhode.evaluation import optional
from polhode.transport.carriers import CarrierT, LoopCarrier, ThreadCarrier
from polhode.transport.exchange import ask, ask_json
from polhode.transport.terms import Operation, Terms, operation

if TYPE_CHECKING:
    import pandas as pd

Item = TypeVar("Item")
Row = dict[str, object]
_PAGE = 200
"""Items on a page, as many as the service takes."""
IDS = 100
"""Ids in one query."""
_LABELS = "labels"
_SHOWN = 20
"""Rows that a notebook shows."""


class Listing(Generic[CarrierT, Item]):
    """The items that match a query, newest first or as ordered; iterate over it, or take it as a frame.

    Parameters
    ----------
    where
        Conditions such as ``"period<5, family=rational"``; docs/queries.md has the language.
    order
        Facts to sort by, such as ``"-energy"``.
    columns
        What :meth:`frame` has by default.
    """

    def __init__(
        self,
        carrier: CarrierT,
        path: str,
        make: Callable[[CarrierT, Document], Item],
        *,
        where: Sequence[str],
        order: str | None,
        columns: Sequence[str],
    ) -> None:
        self.carrier = carrier
        self.columns = columns
        self._path, self._make = path, make
        self._query = [*(("where", each) for each in where if each.strip())]
        if order:
            self._query.append(("order", order))

    @operation
    def frame(
        self, columns: Sequence[str] | None = None, *, limit: int | None = None
    ) -> Operation["pd.DataFrame"]:
        """Return a pandas frame with a row an item.

        Columns are facts, pointers such as /motion/lambda, labels such as label.project, and ``labels``: all.
        """
        pandas: ModuleType = optional("pandas", "frame()")
        wanted = list(columns or self.columns)
        rows = yield from self._facts(wanted, limit)
        frame: pd.DataFrame = pandas.DataFrame(rows, columns=wanted)
        for name in wanted:
            if name.endswith("_at"):
                frame[name] = pandas.to_datetime(frame[name], format="ISO8601")
        return frame

    @operation
    def rows(self, columns: Sequence[str] | None = None, *, limit: int | None = None) -> Operation[list[Row]]:
        """Return a dict an item, with columns as of :meth:`frame`."""
        return (yield from self._facts(list(columns or self.columns), limit))

    @operation
    def all(self, *, limit: int | None = None) -> Operation[list[Item]]:
        """Return all of them, or the first ``limit``."""
        rows = yield from self._rows(limit, [])
        return [self._make(self.carrier, row) for row in rows]

    @operation
    def download(
        self, file_format: str = "csv", columns: Sequence[str] | None = None, *, limit: int | None = None
    ) -> Operation[bytes]:
        """Return all, or the first ``limit``, as a file: ``csv``, ``ndjson``, ``arrow`` or ``parquet``."""
        query = [*self._query, ("format", file_format)]
        query += [] if columns is None else [("columns", ",".join(columns))]
        query += [] if limit is None else [("limit", str(limit))]
        path = f"{self._path}?{urlencode(query)}"
        return (yield from ask(self.carrier.terms, "GET", path, accept="*/*")).content

    @operation
    def count(self) -> Operation[int]:
        """Return how many there are."""
        page = yield from ask_json(self.carrier.terms, "GET", self._first(1, [("count", "exact")]))
        return int(str(page["total"]))

    def __repr__(self) -> str:
        asked = ", ".join(f"{name} {value}" for name, value in self._query)
        return f"<list of {self._path.removeprefix('/v1/')}{': ' if asked else ''}{asked}>"

    def _repr_html_(self) -> str | None:
        if not isinstance(self.carrier, ThreadCarrier):
            return None
        try:
            rows, total = self.carrier.run(self._first_rows())
        except PolhodeError:
            return None  # the words of repr() are better than nothing
        title = f"{self._path.removeprefix('/v1/')}: {total}" + (
            f", of which {_SHOWN}" if total > _SHOWN else ""
        )
        return rows_html(title, self.columns, rows)

    def _first_rows(self) -> Operation[tuple[list[Row], int]]:
        query = [("columns", ",".join(self.columns)), ("count", "exact")]
        page = yield from ask_json(self.carrier.terms, "GET", self._first(_SHOWN, query))
        return items(page["items"]), int(str(page["total"]))

    def __iter__(self: "Listing[ThreadCarrier, Item]") -> Iterator[Item]:
        path: str | None = self._first(_PAGE, [])
        while path is not None:
            rows, path = self.carrier.run(self._page(path))
            yield from (self._make(self.carrier, row) for row in rows)

    async def __aiter__(self: "Listing[LoopCarrier, Item]") -> AsyncIterator[Item]:
        path: str | None = self._first(_PAGE, [])
        while path is not None:
            rows, path = await self.carrier.run_soon(self._page(path))
            for row in rows:
                yield self._make(self.carrier, row)

    def _facts(self, wanted: Sequence[str], limit: int | None) -> Operation[list[Row]]:
        asked = [name for name in wanted if name != _LABELS]
        if asked == wanted:
            return (yield from self._rows(limit, [("columns", ",".join(asked))]))
        # All labels of an item are no column of the service; whole items have them.
        with_id = list(dict.fromkeys([*asked, "id"]))
        rows = yield from self._rows(limit, [("columns", ",".join(with_id))])
        whole = yield from by_id(self.carrier.terms, self._path, [str(row["id"]) for row in rows])
        labels = {each: item[_LABELS] for each, item in whole.items()}
        return [
            {name: labels.get(str(row["id"]), {}) if name == _LABELS else row[name] for name in wanted}
            for row in rows
        ]

    def _rows(self, limit: int | None, query: Sequence[tuple[str, str]]) -> Operation[list[Row]]:
        found: list[Row] = []
        path: str | None = self._first(min(limit or _PAGE, _PAGE), query)
        while path is not None and (limit is None or len(found) < limit):
            rows, path = yield from self._page(path)
            found += rows
        return list(islice(found, limit))

    def _page(self, path: str) -> Operation[tuple[list[Row], str | None]]:
        page = yield from ask_json(self.carrier.terms, "GET", path)
        following = page["next"]
        # The query alone, or of an older service with its path.
        return items(page["items"]), None if following is None else urljoin(path, str(following))

    def _first(self, limit: int, query: Sequence[tuple[str, str]]) -> str:
        return f"{self._path}?{urlencode([*self._query, *query, ('limit', str(limit))])}"


def by_id(terms: Terms, path: str, ids: Sequence[str]) -> Operation[dict[str, Document]]:
    """Return those that there are of a list with these ids."""
    found: dict[str, Document] = {}
    for first in range(0, len(ids), IDS):
        asked = ",".join(ids[first : first + IDS])
        page = yield from ask_json(terms, "GET", f"{path}?where=id%20in%20({asked})&limit={2 * IDS}")
        found |= {str(item["id"]): item for item in items(page["items"])}
    return found
