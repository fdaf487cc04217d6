"""One request and its answer, sent again until there is one; and following a job until it ends."""

import json
import random
import time
import uuid
from collections.abc import Callable, Mapping

from polhode.errors import UnfinishedError, UnreachableError, refused
from polhode.transport.terms import (
    LostConnectionError,
    NextLine,
    Operation,
    Pause,
    Progress,
    Reply,
    Send,
    Terms,
)

MERGE_PATCH = "application/merge-patch+json"
JSON, ARROW, EVENTS = "application/json", "application/vnd.apache.arrow.stream", "text/event-stream"

FIRST_PATIENCE = 10.0
"""Seconds to wait for a service that has not answered yet: its address may be wrong."""
_FIRST_PAUSE, _LONGEST_PAUSE = 0.05, 5.0
_PASSING = (429, 502, 503, 504)
"""Statuses that another try may not have."""
_END_OF_ARROW = b"\xff\xff\xff\xff\x00\x00\x00\x00"
_AT_WORK = "idempotency_key_in_use"
_BUSY = (429, 503)
_LASTING = (":storage_limit", '"exceeds_limit":true', '"exceeds_limit": true')


def ask(
    terms: Terms,
    method: str,
    path: str,
    document: object = None,
    *,
    accept: str = JSON,
    headers: Mapping[str, str] | None = None,
    waits: bool = False,
) -> Operation[Reply]:
    """Return the successful answer to a request.

    Without an answer, and when the service is busy or starts, it is sent again with growing, random pauses.
    What makes something has an Idempotency-Key, so that it is made once however often it is sent.

    Parameters
    ----------
    waits
        A service that answers that it is busy, or that too much is queued, is waited for without an end.

    Raises
    ------
    RefusedError
        The service refused it.
    UnreachableError
        There was no answer for longer than the client's patience.
    """
    url = terms.url + path
    if method == "GET" and terms.cache is not None and (cached := terms.cache.find(url, accept)):
        return cached
    own = {"Accept": f"{accept}, {JSON};q=0.1, application/problem+json", **(headers or {})}
    content = None
    if document is not None:
        content = json.dumps(document, allow_nan=False).encode()
        own.setdefault("Content-Type", JSON)
    if method == "POST":
        own.setdefault("Idempotency-Key", str(uuid.uuid4()))
    reply = yield from _answered(terms, Send(method, path, own, content), waits=waits)
    if not 200 <= reply.status < 300:
        raise refused(reply.status, _document(reply))
    if method == "GET" and terms.cache is not None:
        terms.cache.keep(url, accept, reply)
    return reply


def ask_json(
    terms: Terms,
    method: str,
    path: str,
    document: object = None,
    *,
    headers: Mapping[str, str] | None = None,
    waits: bool = False,
) -> Operation[dict[str, object]]:
    """Return the JSON object with which the service answers; raises as :func:`ask`."""
    reply = yield from ask(terms, method, path, document, headers=headers, waits=waits)
    found = _document(reply)
    if not isinstance(found, dict):
        raise refused(reply.status, "the answer is not a JSON object: is there another service?")
    return found


def open_stream(path: str) -> Operation[Reply]:
    """Return the head of an answer whose lines follow, whatever its status is; it is asked for once."""
    return (yield Send("GET", path, {"Accept": EVENTS}, None, True))


def _answered(terms: Terms, request: Send, *, waits: bool) -> Operation[Reply]:
    began, tries = time.monotonic(), 0
    while True:
        pause = random.uniform(0.5, 1.0) * min(_FIRST_PAUSE * 2**tries, _LONGEST_PAUSE)
        tries += 1
        try:
            reply = yield request
        except LostConnectionError as fault:
            reason = str(fault)
            patience = terms.patience if terms.has_answered else min(FIRST_PATIENCE, terms.patience)
        else:
            terms.has_answered = True
            if not _is_passing(reply) and not _is_torn(reply):
                return reply
            reason, patience = f"HTTP status {reply.status}", terms.patience
            pause = max(pause, _retry_after(reply))
            if waits and reply.status in _BUSY:
                yield Pause(pause)
                began = time.monotonic()
                continue
        if time.monotonic() - began + pause > patience:
            by = (
                ""
                if terms.proxy is None
                else f", asked by {terms.proxy}; hosts in NO_PROXY are asked without"
            )
            seconds = time.monotonic() - began
            raise UnreachableError(
                f"{terms.url} has not answered for {seconds:.0f} s ({reason}{by}); is a service"
                " running there? POLHODE_URL or connect(url) name another address"
            )
        yield Pause(pause)


def _is_passing(reply: Reply) -> bool:
    if reply.status == 409:
        return _AT_WORK.encode() in reply.content
    if reply.status == 429:
        # Neither storage nor a limit below what is asked for becomes free by waiting.
        return not any(word.encode() in reply.content for word in _LASTING)
    return reply.status in _PASSING


def _is_torn(reply: Reply) -> bool:
    """Tell whether an Arrow stream lacks its end: some proxies end an answer whose server has died."""
    is_arrow = reply.headers.get("content-type", "").startswith(ARROW)
    return is_arrow and reply.status == 200 and not reply.content.endswith(_END_OF_ARROW)


def _retry_after(reply: Reply) -> float:
    try:
        return min(float(reply.headers.get("retry-after", "0")), 60.0)
    except ValueError:
        return 0.0


def _document(reply: Reply) -> object:
    try:
        return json.loads(reply.content)
    except ValueError:
        return reply.content.decode("utf-8", "replace")


Resource = dict[str, object]
FINAL = ("succeeded", "failed", "cancelled")
_WITHOUT_EVENTS = (200, 404, 405, 406)
"""Statuses of a service that has no events; 200 with another content, as of a page of a proxy."""
_FIRST_LOOK, _LONGEST_LOOK = 0.02, 1.0


def follow(
    terms: Terms, path: str, known: Resource | None = None, *, seconds: float | None = None, what: str = ""
) -> Operation[Resource]:
    """Return a job or a sweep once it has ended.

    Parameters
    ----------
    known
        What is known of it already.
    seconds
        How long to wait; None: as long as it takes.
    what
        The name of what is followed, for those who follow the progress; without one it is not reported.

    Raises
    ------
    UnfinishedError
        It has not ended in time. It goes on.
    """
    deadline = None if seconds is None else time.monotonic() + seconds
    pause = _FIRST_LOOK
    resource = known if known is not None else (yield from ask_json(terms, "GET", path))
    report = _reporter(terms, what)
    report(resource)
    while resource.get("state") not in FINAL:
        if deadline is not None and time.monotonic() >= deadline:
            raise UnfinishedError(f"{path} is still {resource.get('state')} after {seconds:g} s; it goes on")
        if terms.has_events:
            resource = yield from _listened(terms, path, resource, deadline, report)
            # A stream that broke is opened again, not at once if it keeps breaking.
            if resource.get("state") in FINAL:
                break
        yield Pause(pause)
        pause = min(1.3 * pause, _LONGEST_LOOK)
        resource = yield from ask_json(terms, "GET", path)
        report(resource)
    return resource


def _listened(
    terms: Terms, path: str, resource: Resource, deadline: float | None, report: Callable[[Resource], None]
) -> Operation[Resource]:
    """Return the last state that came as an event, at the end of the stream, or when it broke."""
    try:
        head = yield from open_stream(f"{path}/events")
        if head.status != 200 or not head.headers.get("content-type", "").startswith(EVENTS):
            # None: an older service, or a proxy in between. Others may have events later, as a busy service.
            terms.has_events = head.status not in _WITHOUT_EVENTS
            return resource
        data: list[str] = []
        while (line := (yield NextLine()).line) is not None:
            name, _, value = line.partition(":")
            if name == "data":
                data.append(value.removeprefix(" "))
            elif line == "" and data:
                document = json.loads("\n".join(data))
                data = []
                if isinstance(document, dict) and "state" in document:
                    resource = document
                    report(resource)
                    if resource["state"] in FINAL:
                        return resource
            if deadline is not None and time.monotonic() >= deadline:
                return resource
    except (LostConnectionError, ValueError):
        return resource
    return resource


def _reporter(terms: Terms, what: str) -> Callable[[Resource], None]:
    def report(resource: Resource) -> None:
        if not what or terms.progress is None:
            return
        percent = 100.0 * _number(resource, "progress", 0)
        done, total = _number(resource, "done", percent), _number(resource, "points", 100)
        remaining = resource.get("remaining_seconds")
        seconds = float(remaining) if isinstance(remaining, int | float) else None
        terms.progress(Progress(what, int(done), int(total), seconds, resource.get("state") in FINAL))

    return report


def _number(resource: Resource, name: str, otherwise: float) -> float:
    value = resource.get(name)
    return value if isinstance(value, int | float) else otherwise
