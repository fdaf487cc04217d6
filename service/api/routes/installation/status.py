"""GET /v1/status: the state of the installation, as dashboards show it."""

from dataclasses import asdict

from fastapi import APIRouter, Response

from service.api.dependencies import Inside
from service.api.queries.queries import without_query
from service.api.replies.responses import json_response, refusals
from service.jobs.records import AttemptOutcome
from service.schemas.replies.job import StatusOut
from service.settings import Settings
from service.storage.database.database import Database
from service.storage.jobs.worker_registry import SILENT_LEASES
from service.storage.upkeep.presence import GONE_SECONDS
from service.storage.upkeep.status import status_of

router = APIRouter(prefix="/v1")


@router.get(
    "/status", tags=["status"], response_model=StatusOut, responses=refusals(), dependencies=[without_query]
)
def get_status(inside: Inside) -> Response:
    """Tell what waits, what each worker does, and how many jobs ended lately."""
    return json_response(status_document(inside.database, inside.settings))


def status_document(database: Database, settings: Settings) -> StatusOut:
    """Return the answer that shows the status."""
    seen_seconds = max(GONE_SECONDS, SILENT_LEASES * settings.lease_seconds)
    status = status_of(database, seen_seconds=seen_seconds)
    document = {
        "at": status.at,
        "queue": [asdict(part) for part in status.queue],
        "workers": [asdict(worker) for worker in status.workers],
        "rates": [
            {"minutes": rate.minutes, **{word.value: rate.by_outcome.get(word, 0) for word in AttemptOutcome}}
            for rate in status.rates
        ],
    }
    return StatusOut.model_validate(document)
