"""Calls the child process that examines documents, and reads its answer."""

import json
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any  # Any: a document that was read from JSON

from service.api.replies.errors import ApiError
from service.api.verdicts.verdict_queue import Claimant, Examination, VerdictQueue
from service.schemas.reading.documents import Fault


async def examine(
    verdicts: VerdictQueue, examination: Examination, text: str, claimant: Claimant
) -> Mapping[str, object] | None:
    """Return the examination's answer to the JSON document ``text``: a verdict, or None if it needs none.

    Raises
    ------
    ApiError
        422 with what the examination found; 503 if too many wait for verdicts.
    SandboxTimeoutError, SandboxMemoryError, SandboxCrashError
        The computation did not finish.
    """
    return verdict_in(json.loads(await verdicts.ask(examination, text, claimant)))


def verdict_in(answer: Mapping[str, Any]) -> Mapping[str, object] | None:
    """Return the verdict in an answer of the child, None if it has none; raise the error in it."""
    if "error" in answer:
        raise _refusal(answer["error"])
    verdict: Mapping[str, object] | None = answer["verdict"]
    return verdict


def _refusal(error: Mapping[str, object]) -> ApiError:
    extras = dict(error)
    code, detail, pointer = (str(extras.pop(name)) for name in ("code", "detail", "pointer"))
    given = extras.pop("faults", None)
    if isinstance(given, list):
        faults = [Fault(**fault) for fault in given]
    else:
        faults = [Fault(pointer, code, detail)] if pointer else []
    return ApiError(HTTPStatus.UNPROCESSABLE_ENTITY, code, detail, faults=faults, extras=extras)
