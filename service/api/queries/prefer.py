"""Reads the Prefer header (RFC 7240): how long a client waits for its job."""

import re
from typing import Annotated

from fastapi import Header

MAX_WAIT_SECONDS = 60

Prefer = Annotated[
    str | None, Header(description="`wait=S`: wait up to S ≤ 60 seconds for the job to finish.")
]
"""The type of an endpoint's parameter that receives the header."""

_WAIT = re.compile(r"(?:^|,)\s*wait\s*=\s*\"?(\d{1,9})\"?\s*(?=[,;]|$)", re.IGNORECASE | re.ASCII)


def wait_seconds(header: str | None) -> int | None:
    """Return the seconds to wait, capped, or None if the client does not wait.

    A preference that cannot be read is ignored, as the RFC says.
    """
    match = _WAIT.search(header or "")
    return None if match is None else min(int(match[1]), MAX_WAIT_SECONDS)
