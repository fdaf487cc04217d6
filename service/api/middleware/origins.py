"""Checks a request before authentication: same origin, and an unambiguous length."""

from collections.abc import Collection
from http import HTTPStatus
from urllib.parse import urlsplit

from starlette.datastructures import Headers

from service.api.replies.errors import ApiError

_SAFE = frozenset({"GET", "HEAD", "OPTIONS", "TRACE"})
_OWN_SITES = frozenset({"same-origin", "none"})
_PORTS = {"http": 80, "https": 443}


def check_origin(method: str, headers: Headers, trusted: Collection[str]) -> None:
    """Refuse state-changing requests from pages of another origin; programs send no such headers.

    Browsers send Sec-Fetch-Site, which is right behind any proxy too. Without it
    (older browsers, plain HTTP to another machine), Origin must have the host and
    port of Host, or be one of ``trusted``.

    Raises
    ------
    ApiError
        403.
    """
    origin, site = headers.get("origin"), headers.get("sec-fetch-site")
    if method in _SAFE or (origin is None and site is None):
        return
    if origin and origin in trusted:
        return
    if site is not None:
        if site in _OWN_SITES:
            return
    elif _is_of_host(origin or "", headers.get("host", "")):
        return
    detail = (
        f"the request was sent by a page of {(origin or 'another origin')[:100]!r}; "
        "accepted are pages of this service, and those that POLHODE_ORIGINS or POLHODE_CORS_ORIGINS names"
    )
    raise ApiError(HTTPStatus.FORBIDDEN, "cross_origin", detail)


def check_length(version: str, headers: Headers) -> None:
    """Refuse a request whose length is ambiguous, against request smuggling (RFC 9112, 6.1 and 11.2).

    Raises
    ------
    ApiError
        400; the connection is closed, since the next bytes may be another client's.
    """
    if "transfer-encoding" not in headers:
        return
    if "content-length" in headers:
        detail = "both Content-Length and Transfer-Encoding were sent; one of them is accepted"
    elif version == "1.0":
        detail = "Transfer-Encoding was sent with HTTP/1.0; it is accepted with HTTP/1.1"
    else:
        return
    raise ApiError(HTTPStatus.BAD_REQUEST, "ambiguous_length", detail, headers={"Connection": "close"})


def _is_of_host(origin: str, host: str) -> bool:
    try:
        page, here = urlsplit(origin), urlsplit(f"//{host}")
        port = _PORTS.get(page.scheme)
        return page.hostname is not None and (page.hostname, page.port or port) == (
            here.hostname,
            here.port or port,
        )
    except ValueError:
        return False
