"""Stored things that match a query: read page by page, by cursors, as they are needed."""

from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from itertools import islice
from types import ModuleType
from typing import TYPE_CHECKING, Generic, TypeVar
from urllib.parse import urlencode

from polhode.documents.problems import Document
from polhode.evaluation.samples import optional
from polhode.transport.carriers import CarrierT, LoopCarrier, ThreadCarrier
from polhode.transport.exchange import ask_json
from polhode.transport.steps import Operation, operation

if TYPE_CHECKING:
    import pandas as pd

Item = TypeVar("Item")
Row = dict[str, object]
_PAGE = 200


class Listing(Generic[CarrierT, Item]):
    """What matches a query, newest first or as ordered; iterate over it, or take it as a frame.

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
        self._path, self._make, self._columns = path, make, columns
        self._query = [*(("where", each) for each in where if each.strip())]
        if order:
            self._query.append(("order", order))

    @operation
    def frame(
        self, columns: Sequence[str] | None = None, *, limit: int | None = None
    ) -> Operation["pd.DataFrame"]:
        """Return a pandas frame with a row an item; columns are facts and pointers such as /motion/lambda."""
        pandas: ModuleType = optional("pandas", "frame()")
        wanted = list(columns or self._columns)
        rows = yield from self._rows(limit, [("columns", ",".join(wanted))])
        frame: pd.DataFrame = pandas.DataFrame(rows, columns=wanted)
        for name in wanted:
            if name.endswith("_at"):
                frame[name] = pandas.to_datetime(frame[name], format="ISO8601")
        return frame

    @operation
    def rows(self, columns: Sequence[str] | None = None, *, limit: int | None = None) -> Operation[list[Row]]:
        """Return a dict an item, with facts and pointers such as /motion/lambda."""
        return (yield from self._rows(limit, [("columns", ",".join(columns or self._columns))]))

    @operation
    def all(self, *, limit: int | None = None) -> Operation[list[Item]]:
        """Return all of them, or the first ``limit``."""
        rows = yield from self._rows(limit, [])
        return [self._make(self.carrier, row) for row in rows]

    @operation
    def count(self) -> Operation[int]:
        """Return how many there are."""
        page = yield from ask_json(self.carrier.terms, "GET", self._first(1, [("count", "exact")]))
        return int(str(page["total"]))

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

    def _rows(self, limit: int | None, query: Sequence[tuple[str, str]]) -> Operation[list[Row]]:
        found: list[Row] = []
        path: str | None = self._first(min(limit or _PAGE, _PAGE), query)
        while path is not None and (limit is None or len(found) < limit):
            rows, path = yield from self._page(path)
            found += rows
        return list(islice(found, limit))

    def _page(self, path: str) -> Operation[tuple[list[Row], str | None]]:
        page = yield from ask_json(self.carrier.terms, "GET", path)
        items, following = page["items"], page["next"]
        assert isinstance(items, list)
        return items, None if following is None else str(following)

    def _first(self, limit: int, query: Sequence[tuple[str, str]]) -> str:
        return f"{self._path}?{urlencode([*self._query, *query, ('limit', str(limit))])}"
