"""The service's name and version in the Server header, and the header of a request's id."""

from functools import cache

from service.versions import version_of

REQUEST_ID = "X-Request-ID"


@cache
def server_name() -> str:
    """Return the value of the Server header."""
    return f"polhode/{version_of('polhode')}"
