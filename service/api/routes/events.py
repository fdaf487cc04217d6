"""Streams of events: what happens to a job, to a sweep, and in the installation, as it happens."""

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import aclosing
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Header, Request, Response
from sqlalchemy.exc import SQLAlchemyError
from starlette.concurrency import run_in_threadpool
from starlette.responses import StreamingResponse

from service.api.dependencies import Inside, Resources
from service.api.events.poller import HEARTBEAT, MEDIA_TYPE, OPENING, Documents, Event, position_of_id
from service.api.middleware.caching import is_head
from service.api.middleware.security import Holder
from service.api.queries.queries import without_query
from service.api.replies import NO_STORE, ApiError, JobId, SweepId, job_out, json_content, refusals, sweep_out
from service.api.routes.installation import status_document
from service.jobs.keys import ApiKey, KeyStanding
from service.jobs.records import Job, SweepRecord
from service.schemas.replies.job import StatusOut
from service.settings import Settings
from service.storage.database.availability import is_away
from service.storage.database.database import Database
from service.storage.jobs.rows import Followable

router = APIRouter(prefix="/v1", tags=["events"])

HEARTBEAT_SECONDS = 15.0
"""A comment is sent so often, and the key is checked."""
RETRY_SECONDS = 5
"""Retry-After for clients that find all streams taken."""

LastEventId = Annotated[
    str | None,
    Header(
        alias="Last-Event-ID",
        description="The `id` of the last event that the client has got: only what is new is sent.",
    ),
]


class EventStream(StreamingResponse):
    """An answer that goes on until there is nothing more to send."""

    media_type = MEDIA_TYPE


_SCHEMA = {
    "type": "object",
    "description": "One of the events, which follow each other as text.",
    "properties": {name: {"type": "string"} for name in ("event", "id", "data")},
}


def _described(name: str, data: str) -> dict[int | str, dict[str, object]]:
    example = f": polhode\nretry: 2000\n\nevent: {name}\nid: 41da7f2c6b8a1d00\ndata: {data}\n\n"
    content = {MEDIA_TYPE: {"schema": _SCHEMA, "example": example}}
    return {200: {"description": "Events, until the end", "content": content}}


@router.get(
    "/jobs/{job_id}/events",
    response_class=EventStream,
    responses={**_described("job", '{"id": "…", "state": "running", …}'), **refusals(404, 503)},
    dependencies=[without_query],
)
async def follow_job(
    request: Request, job_id: JobId, inside: Inside, holder: Holder, last_event_id: LastEventId = None
) -> Response:
    """Send each state of a job, as `GET /v1/jobs/{job_id}` shows it, from the present one to the final one.

    Each is an event `job`, the last event is `end`. A client that reads slowly gets the
    latest state only.
    """
    job = await run_in_threadpool(inside.jobs.get, job_id)
    events = inside.events.follow((Followable.JOB, job.id), last_event_id)
    return _stream(request, inside, holder, events)


@router.get(
    "/sweeps/{sweep_id}/events",
    response_class=EventStream,
    responses={**_described("sweep", '{"id": "…", "done": 250, …}'), **refusals(404, 503)},
    dependencies=[without_query],
)
async def follow_sweep(
    request: Request, sweep_id: SweepId, inside: Inside, holder: Holder, last_event_id: LastEventId = None
) -> Response:
    """Send each state of a sweep, as `GET /v1/sweeps/{sweep_id}` shows it, up to the final one.

    Each is an event `sweep`, the last event is `end`. A client that reads slowly gets
    the latest state only.
    """
    sweep = await run_in_threadpool(inside.sweeps.get, sweep_id)
    events = inside.events.follow((Followable.SWEEP, sweep.id), last_event_id)
    return _stream(request, inside, holder, events)


@router.get(
    "/events",
    response_class=EventStream,
    responses={**_described("status", '{"queue": […], "workers": […], …}'), **refusals(503)},
    dependencies=[without_query],
)
async def follow_installation(
    request: Request, inside: Inside, holder: Holder, last_event_id: LastEventId = None
) -> Response:
    """Send the status, and every job and sweep that changes, until the service stops.

    Events `status`, `job` and `sweep` are what GET shows of them; the last event is `end`. It
    begins with the status, and with what changed in the last seconds, or since
    the event that Last-Event-ID names.
    """
    now = await run_in_threadpool(inside.events.now)
    events = inside.events.follow_all(now, position_of_id(last_event_id))
    return _stream(request, inside, holder, events)


def documents_of(database: Database, settings: Settings) -> Documents:
    """Return how the answers to GET are made."""

    def status() -> tuple[bytes, object]:
        document = status_document(database, settings)
        return json_content(document), _substance(document)

    def job(job: Job) -> bytes:
        return json_content(job_out(job))

    def sweep(record: SweepRecord) -> bytes:
        return json_content(sweep_out(record))

    return Documents(job, sweep, status)


def _substance(status: StatusOut) -> object:
    """Return the status without what is different at every poll."""
    return status.model_dump(
        exclude={
            "at": True,
            "queue": {"__all__": {"oldest_seconds"}},
            "workers": {"__all__": {"silent_seconds": True, "running": {"__all__": {"seconds"}}}},
        }
    )


def _stream(
    request: Request, inside: Resources, holder: ApiKey | None, events: AsyncGenerator[Event | None, None]
) -> Response:
    # Without the second, nginx would hand events on when its buffer is full.
    headers = {"Cache-Control": NO_STORE, "X-Accel-Buffering": "no"}
    if is_head(request):
        return Response(headers={**headers, "Content-Type": MEDIA_TYPE})
    if inside.events.is_full:
        raise ApiError(
            HTTPStatus.SERVICE_UNAVAILABLE,
            "too_many_streams",
            f"{inside.events.capacity} streams of events are open, as many as are accepted; try again later",
            headers={"Retry-After": str(RETRY_SECONDS)},
        )
    return EventStream(_texts(inside, holder, events), headers=headers)


async def _texts(
    inside: Resources, holder: ApiKey | None, events: AsyncGenerator[Event | None, None]
) -> AsyncIterator[bytes]:
    """Yield what is sent: a comment at once and every so often, and the events."""
    yield OPENING
    clock = asyncio.get_running_loop().time
    beat = clock()
    try:
        async with aclosing(events):
            async for event in events:
                if event is not None:
                    yield event.text()
                if clock() - beat >= HEARTBEAT_SECONDS:
                    beat = clock()
                    if not await _is_live(inside, holder):
                        return
                    yield HEARTBEAT
    except SQLAlchemyError as fault:
        if not is_away(fault):
            raise
        # The client connects again, and gets 503 until the database is back.
        inside.events.complaints.tell("a stream of events has ended: the database cannot be reached")


async def _is_live(inside: Resources, holder: ApiKey | None) -> bool:
    """Tell whether the key of a stream is still good."""
    if holder is None:
        return True
    known = await inside.keys.known()
    key = known.keys.get(holder.prefix)
    return key is not None and key.standing(inside.keys.now(known)) is KeyStanding.LIVE
