"""Reads the Prefer header (RFC 7240): how long a client waits for its job, and whether it wants one."""

import re
from typing import Annotated

from fastapi import Header

MAX_WAIT_SECONDS = 60

Prefer = Annotated[
    str | None, Header(description="`wait=S`: wait up to S ≤ 60 seconds for the job to finish.")
]
"""The type of an endpoint's parameter that receives the header."""

PreferJob = Annotated[
    str | None,
    Header(
        alias="Prefer",
        description="`respond-async`: a job finds the answer, however fast it is. `wait=S`: if there is a"
        " job, wait up to S ≤ 60 seconds for it to finish.",
    ),
]
"""The same of an endpoint that answers by a job where it takes long."""

_WAIT = re.compile(r"(?:^|,)\s*wait\s*=\s*\"?(\d{1,9})\"?\s*(?=[,;]|$)", re.IGNORECASE | re.ASCII)

_ASYNC = re.compile(r"(?:^|,)\s*respond-async\s*(?=[,;]|$)", re.IGNORECASE | re.ASCII)


def wait_seconds(header: str | None) -> int | None:
    """Return the seconds to wait, capped, or None if the client does not wait.

    A preference that cannot be read is ignored, as the RFC says.
    """
    match = _WAIT.search(header or "")
    return None if match is None else min(int(match[1]), MAX_WAIT_SECONDS)


def wants_job(header: str | None) -> bool:
    """Tell whether the client prefers a job to an answer that it waits for."""
    return _ASYNC.search(header or "") is not None
