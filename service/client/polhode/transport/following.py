"""Waits until a job or a sweep has ended: by events, or by asking again where there are none."""

import json
import time
from collections.abc import Callable

from polhode.errors import UnfinishedError
from polhode.transport.exchange import EVENTS, ask_json, open_stream
from polhode.transport.steps import LostConnectionError, NextLine, Operation, Pause
from polhode.transport.terms import Progress, Terms

Resource = dict[str, object]
FINAL = ("succeeded", "failed", "cancelled")
_WITHOUT_EVENTS = (200, 404, 405, 406)
"""Statuses of a service that has no events; 200 with another content, as of a page of a proxy."""
_FIRST_PAUSE, _LONGEST_PAUSE = 0.02, 1.0


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
        The name of what is followed, for those who are told the progress; nobody is told without one.

    Raises
    ------
    UnfinishedError
        It has not ended in time. It goes on.
    """
    deadline = None if seconds is None else time.monotonic() + seconds
    pause = _FIRST_PAUSE
    resource = known if known is not None else (yield from ask_json(terms, "GET", path))
    tell = _teller(terms, what)
    tell(resource)
    while resource.get("state") not in FINAL:
        if deadline is not None and time.monotonic() >= deadline:
            raise UnfinishedError(f"{path} is still {resource.get('state')} after {seconds:g} s; it goes on")
        if terms.has_events:
            resource = yield from _listened(terms, path, resource, deadline, tell)
            # A stream that broke is opened again, not at once if it keeps breaking.
            if resource.get("state") in FINAL:
                break
        yield Pause(pause)
        pause = min(1.3 * pause, _LONGEST_PAUSE)
        resource = yield from ask_json(terms, "GET", path)
        tell(resource)
    return resource


def _listened(
    terms: Terms, path: str, resource: Resource, deadline: float | None, tell: Callable[[Resource], None]
) -> Operation[Resource]:
    """Return what events told last, at the end of their stream, or when it broke."""
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
                told = json.loads("\n".join(data))
                data = []
                if isinstance(told, dict) and "state" in told:
                    resource = told
                    tell(resource)
                    if resource["state"] in FINAL:
                        return resource
            if deadline is not None and time.monotonic() >= deadline:
                return resource
    except (LostConnectionError, ValueError):
        return resource
    return resource


def _teller(terms: Terms, what: str) -> Callable[[Resource], None]:
    def tell(resource: Resource) -> None:
        if not what or terms.progress is None:
            return
        done, total = _number(resource, "done", 0), _number(resource, "points", 1)
        remaining = resource.get("remaining_seconds")
        seconds = float(remaining) if isinstance(remaining, int | float) else None
        terms.progress(Progress(what, int(done), int(total), seconds, resource.get("state") in FINAL))

    return tell


def _number(resource: Resource, name: str, otherwise: float) -> float:
    value = resource.get(name)
    return value if isinstance(value, int | float) else otherwise
