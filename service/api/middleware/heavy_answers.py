"""Has the answers of some endpoints made within the limits of heavy reads, and counted until they are sent.

The work of a request ends when its client disconnects. Files that everybody may read are light, but a
thousand clients may ask for one in the same moment: few of these answers begin at once.
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from functools import partial, wraps
from typing import Any, ParamSpec, TypeVar  # Any: the send type of a coroutine, which is not used

from fastapi import Request, Response
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.dependencies import Resources
from service.api.formats.lists import Found, ListedRows, media_type_of
from service.api.formats.negotiation import JSON
from service.api.heavy_reads import Reader
from service.api.middleware.caching import is_head
from service.api.middleware.security import holder_of
from service.api.queries.lists import NEWEST_FIRST, AnyAsking, Listing, read_listing
from service.api.queries.queries import Asked
from service.api.replies import PART_BYTES, ApiError, PiecedAnswer, size_of
from service.schemas.query.terms import Condition, OrderKey
from service.storage.searching.sources import Source, with_names

T = TypeVar("T")


async def while_connected(request: Request, work: Coroutine[Any, Any, T]) -> T:
    """Return the result of ``work``; its body must have been read.

    Raises
    ------
    ClientDisconnect
        The client disconnected first; ``work`` was cancelled.
    """
    working, leaving = asyncio.create_task(work), asyncio.create_task(_until_gone(request))
    try:
        await asyncio.wait({working, leaving}, return_when=asyncio.FIRST_COMPLETED)
        if not working.done():
            raise ClientDisconnect
        return working.result()
    finally:
        unfinished = [task for task in (working, leaving) if task.cancel()]
        await asyncio.gather(*unfinished, return_exceptions=True)


async def _until_gone(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


P = ParamSpec("P")

_INDEXED = frozenset({"state", "digest"})
"""Facts by which the newest rows are found at once."""
_AGE = frozenset({"id", "created_at"})
_NEAR = 1000
"""Rows that are left out at once."""


def heavy(endpoint: Callable[P, Response]) -> Callable[P, Awaitable[Response]]:
    """Return an endpoint that computes or builds much, made to wait for a slot.

    It needs the parameters ``request`` and ``inside``.
    """

    @wraps(endpoint)
    async def in_a_slot(*args: P.args, **kwargs: P.kwargs) -> Response:
        request, inside = kwargs["request"], kwargs["inside"]
        # FastAPI calls endpoints by the names of their parameters, of which types know nothing.
        assert isinstance(request, Request)
        assert isinstance(inside, Resources)
        return await made_in_a_slot(request, inside, partial(endpoint, *args, **kwargs))

    return in_a_slot


async def made_in_a_slot(request: Request, inside: Resources, make: Callable[[], Response]) -> Response:
    """Return the answer that ``make`` makes, once it is its turn.

    Raises
    ------
    ApiError
        503: too many wait, or too much waits to be sent.
    ClientDisconnect
        The client has gone.
    """
    reads, key = inside.heavy, holder_of(request)
    reader = Reader(None, request.client) if key is None else Reader(key.id)
    answer = await while_connected(request, reads.begin(reader, make))
    if isinstance(answer, PiecedAnswer):
        if is_head(request):
            return _head_of(answer)
        answer.compute = partial(reads.go_on, reader)
    if size_of(answer) <= PART_BYTES:
        return answer
    return _Counted(answer, await while_connected(request, reads.hold(reader, size_of(answer))))


async def read_list(
    inside: Resources,
    asked: Asked[AnyAsking],
    source: Source,
    *,
    conditions: Sequence[Condition] = (),
    order: tuple[OrderKey, ...] = NEWEST_FIRST,
) -> Listing:
    """Return the list that is asked for, as :func:`read_listing`; names it does not know are looked up."""
    # What is wrong is told without a thread, of which a slow database may leave none.
    read = partial(read_listing, asked, conditions=conditions, order=order)
    try:
        return read(source)
    except ApiError as refusal:
        if all(fault.code != "unknown_column" for fault in refusal.faults):
            raise
    return await run_in_threadpool(lambda: read(with_names(inside.database, source)))


async def listed(request: Request, inside: Resources, listing: Listing, rows: ListedRows[Found]) -> Response:
    """Return a list: in a slot of heavy reads if it is a stream, or its conditions or order may take long."""
    query = listing.query
    if query.is_estimated:
        return listing.estimate()
    make = partial(rows.answer, request, listing)
    if media_type_of(listing.format, request.headers.get("accept")) != JSON:
        return await made_in_a_slot(request, inside, make)
    is_quick = all(each.subject.name in _INDEXED for each in query.conditions)
    is_by_age = all(key.subject.name in _AGE for key in query.order)
    is_bounded = not query.is_counted or query.count_limit is not None
    if is_quick and is_by_age and is_bounded and query.offset <= _NEAR:
        return await run_in_threadpool(make)
    return await made_in_a_slot(request, inside, make)


class _Counted(Response):
    """An answer that is counted until it has been sent, or cannot be."""

    def __init__(self, answer: Response, release: Callable[[], None]) -> None:
        super().__init__(status_code=answer.status_code)
        self.raw_headers = answer.raw_headers
        if not isinstance(answer, PiecedAnswer):
            self.body = answer.body
        self._answer, self._release = answer, release

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it."""
        try:
            await self._answer(scope, receive, send)
        finally:
            self._release()


def _head_of(answer: PiecedAnswer) -> Response:
    head = Response(status_code=answer.status_code)
    head.raw_headers = answer.raw_headers
    return head


_FILES = ("/static/", "/docs", "/openapi.json")
_BEGINNING = 4
"""Answers with files that may begin at once."""


class FilesInTurns:
    """Lets other requests in between those for files, which wait until few of them have not begun."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._places = asyncio.Semaphore(_BEGINNING)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, if it is for a file once it is its turn."""
        path = scope.get("path", "").removeprefix(scope.get("root_path", ""))
        if scope["type"] != "http" or not path.startswith(_FILES):
            await self._app(scope, receive, send)
            return
        await self._places.acquire()
        has_begun = False

        async def send_begun(message: Message) -> None:
            nonlocal has_begun
            if not has_begun:
                # How long the client reads concerns nobody else.
                has_begun = True
                self._places.release()
            await send(message)

        try:
            await self._app(scope, receive, send_begun)
        finally:
            if not has_begun:
                self._places.release()
