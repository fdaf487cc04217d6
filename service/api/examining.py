"""Asks the child process that examines documents, and reads its answer."""

import json
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import Any  # Any: a document that was read from JSON

from service.api.errors import ApiError
from service.api.resources import Resources
from service.schemas.faults import Fault


def examine(
    resources: Resources, function: Callable[[str], str], document: object
) -> Mapping[str, object] | None:
    """Return the verdict on ``document``, or None if it asks for none.

    Raises
    ------
    ApiError
        422 with what the examination found.
    SandboxTimeoutError, SandboxMemoryError, SandboxCrashError
        It did not come to an end.
    """
    text = json.dumps(document)
    answer = json.loads(resources.sandbox.run(function, text, seconds=resources.settings.verdict_seconds))
    return verdict_in(answer)


def verdict_in(answer: Mapping[str, Any]) -> Mapping[str, object] | None:
    """Return the verdict in an answer of the child, None if there is none to give; raises as it says."""
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
