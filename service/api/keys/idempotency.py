"""Answers a request with an Idempotency-Key once, and then gives the same answer again."""

import re
import threading
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Annotated, Any  # Any: the send type of a coroutine, which is not used

from fastapi import Header, Request, Response
from starlette.concurrency import run_in_threadpool

from service.api.replies import ApiError, invalid_request
from service.jobs.keys import ApiKey
from service.schemas.reading.documents import Fault
from service.storage.keys import (
    GivenAnswer,
    GivenKey,
    IdempotencyStore,
    KeyTakenError,
    Made,
    Receipt,
    fingerprint,
)

REPLAYED = "Idempotency-Replayed"
IN_USE_SECONDS = 1
"""Retry-After while the first request is at work."""
_KEPT_HEADERS = ("location", "content-type", "preference-applied")
_ACCEPTED = re.compile(r"[\x21-\x7e]{1,255}")

IdempotencyKey = Annotated[
    str | None,
    Header(
        description="1 to 255 visible characters of your choice. The same request with the same key brings"
        " the same answer for 24 hours, marked `Idempotency-Replayed: true`, and makes nothing twice.",
        json_schema_extra={"pattern": "^[!-~]{1,255}$"},
    ),
]
"""The type of an endpoint's parameter that receives the key."""


def read_key(header: str | None, request: Request, content: bytes, holder: ApiKey | None) -> GivenKey | None:
    """Return the key of a request; None if it has none.

    Raises
    ------
    ApiError
        422 if it is not 1 to 255 visible characters.
    """
    if header is None:
        return None
    if not _ACCEPTED.fullmatch(header):
        message = f"{header[:40]!r}; 1 to 255 visible ASCII characters without spaces are accepted"
        raise invalid_request([Fault("header Idempotency-Key", "invalid_value", message)])
    query = sorted(request.query_params.multi_items())
    said = request.method, request.url.path, repr(query)
    parts = fingerprint(*(text.encode() for text in said), content)
    return GivenKey("" if holder is None else holder.id, header, parts)


def receipt_of(given: GivenKey | None, answer: Callable[[Made], Response]) -> Receipt[Made] | None:
    """Return what the store writes with what it makes; None without a key."""
    return None if given is None else Receipt(given, lambda made: given_answer(answer(made)))


def given_answer(response: Response) -> GivenAnswer:
    """Return an answer as it is stored."""
    headers = {name: response.headers[name] for name in _KEPT_HEADERS if name in response.headers}
    return GivenAnswer(response.status_code, headers, bytes(response.body))


class IdempotencyGuard:
    """Answers a request that is sent again with its first answer. Thread-safe.

    Requests at work are known in this process alone. If two processes get the same key at
    once, both work, and the database lets only one of them store anything: the other gives its answer.
    """

    def __init__(self, store: IdempotencyStore) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._at_work: set[tuple[str, str]] = set()

    async def once(
        self, given: GivenKey | None, work: Callable[[], Coroutine[Any, Any, Response]]
    ) -> Response:
        """Return the answer that was given to the same request, or else that of ``work``.

        Raises
        ------
        ApiError
            409 while the first request is at work, 422 if it was another request.
        """
        if given is None:
            return await work()
        with self._hold(given):
            if (known := await run_in_threadpool(self._again, given)) is not None:
                return known
            try:
                return await work()
            except KeyTakenError:
                known = await run_in_threadpool(self._again, given)
                if known is None:  # it was forgotten within this second
                    raise _in_use() from None
                return known

    def keep(self, given: GivenKey | None, response: Response) -> None:
        """Keep the answer for which the client has waited, in place of the first one."""
        if given is not None:
            self._store.replace(given, given_answer(response))

    @contextmanager
    def _hold(self, given: GivenKey) -> Iterator[None]:
        entry = given.principal, given.key
        with self._lock:
            if entry in self._at_work:
                raise _in_use()
            self._at_work.add(entry)
        try:
            yield
        finally:
            with self._lock:
                self._at_work.discard(entry)

    def _again(self, given: GivenKey) -> Response | None:
        found = self._store.find(given)
        if found is None:
            return None
        first, answer = found
        if first != given.fingerprint:
            detail = (
                "this Idempotency-Key was sent with another request less than 24 hours ago; "
                "accepted are the same method, path, query and body, or another key"
            )
            raise ApiError(HTTPStatus.UNPROCESSABLE_ENTITY, "idempotency_key_reused", detail)
        return Response(answer.body, status_code=answer.status, headers={**answer.headers, REPLAYED: "true"})


def _in_use() -> ApiError:
    detail = "the first request with this Idempotency-Key is still at work; ask again for its answer"
    headers = {"Retry-After": str(IN_USE_SECONDS)}
    return ApiError(HTTPStatus.CONFLICT, "idempotency_key_in_use", detail, headers=headers)
