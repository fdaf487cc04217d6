"""Checks, authenticates and authorises every request before its endpoint runs; pages of other origins (CORS).

Accepted are the same origin, or one that is named, and an unambiguous length; then the key, its rate and its
role are checked.
"""

from collections.abc import Collection, Sequence
from functools import lru_cache
from http import HTTPStatus
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import Depends, Request, Response
from sqlalchemy.exc import SQLAlchemyError
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from service.api.dependencies import Resources
from service.api.keys.access import OPEN, OPTIONS, SECOND_LOOK_SECONDS, Access
from service.api.middleware.error_handlers import respond
from service.api.middleware.observing import RATE
from service.api.replies import ApiError
from service.jobs.keys import ApiKey, KeyStanding, Role, key_prefix
from service.schemas.reading.documents import Fault
from service.schemas.reading.numbers import HIGHEST_PRIORITY
from service.settings import Settings, is_this_machine, origins_in

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


_MAX_AGE_SECONDS = 600
"""How long a browser may remember what it may send."""
_METHODS = "GET, HEAD, POST, PATCH, DELETE, OPTIONS"
_SENT = (
    "Accept, Authorization, Content-Encoding, Content-Type, Idempotency-Key, If-None-Match, Last-Event-ID,"
    " Polhode-Echo, Prefer, X-Request-ID"
)
# A wildcard would leave out Authorization, and older browsers do not know it.
_SHOWN = (
    "Content-Disposition, ETag, Idempotency-Replayed, Link, Location, Polhode-Deviation, Polhode-Echo,"
    " Polhode-Error, Polhode-Points, Polhode-Points-Done, Polhode-Samples, Preference-Applied, RateLimit,"
    " RateLimit-Policy, Retry-After, Server, X-Request-ID"
)


class Sharing:
    """Adds the headers that browsers ask for. Keys are sent by scripts, never by browsers: no credentials."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a preflight, or pass the request on and mark its answer."""
        shared = _shared_with(scope) if scope["type"] == "http" else frozenset[str]()
        if not shared:
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        origin = headers.get("origin")
        allowed = {"Access-Control-Allow-Origin": origin} if origin in shared and origin else {}

        async def send_marked(message: Message) -> None:
            if message["type"] == "http.response.start":
                marked = MutableHeaders(scope=message)
                # Caches must keep apart what is sent to different origins, and to none.
                marked.add_vary_header("Origin")
                marked.update({**allowed, **({"Access-Control-Expose-Headers": _SHOWN} if allowed else {})})
            await send(message)

        if allowed and scope["method"] == "OPTIONS" and "access-control-request-method" in headers:
            answer = Response(
                status_code=HTTPStatus.NO_CONTENT,
                headers={
                    "Access-Control-Allow-Methods": _METHODS,
                    "Access-Control-Allow-Headers": _SENT,
                    "Access-Control-Max-Age": str(_MAX_AGE_SECONDS),
                },
            )
            await answer(scope, receive, send_marked)
            return
        await self._app(scope, receive, send_marked)


def _shared_with(scope: Scope) -> frozenset[str]:
    resources: Resources = scope["app"].state.resources
    return origins_in(resources.settings.cors_origins)


_CHALLENGE = "WWW-Authenticate"
_STATE = "key"
_PAST = {KeyStanding.EXPIRED: "expired", KeyStanding.REVOKED: "been revoked"}


class Guard:
    """Passes a request with its key to the endpoints, or refuses it."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._access = Access()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check a request by its headers alone, before its body is read."""
        if scope["type"] == "websocket":  # there are none
            await WebSocketClose()(scope, receive, send)
            return
        if scope["type"] == "http":
            try:
                headers = Headers(scope=scope)
                check_length(scope["http_version"], headers)
                settings: Settings = scope["app"].state.resources.settings
                trusted = origins_in(settings.origins) | origins_in(settings.cors_origins)
                check_origin(scope["method"], headers, trusted)
                key = await self._admit(scope)
            except (ApiError, HTTPException, SQLAlchemyError) as error:
                answer = await respond(Request(scope), error)
                await answer(scope, receive, send)
                return
            if scope["method"] == OPTIONS:
                answer = Response(
                    status_code=HTTPStatus.NO_CONTENT, headers={"Allow": self._access.allowed(scope["path"])}
                )
                await answer(scope, receive, send)
                return
            scope.setdefault("state", {})[_STATE] = key
        await self._app(scope, receive, send)

    async def _admit(self, scope: Scope) -> ApiKey | None:
        try:
            needed, refusal = self._access.needed(scope["method"], scope["path"]), None
            if needed is OPEN:
                return None
        except HTTPException as unknown:
            # Only clients with a key learn whether the path exists.
            needed, refusal = OPEN, unknown
        resources: Resources = scope["app"].state.resources
        key = await _identify(Headers(scope=scope), resources)
        scope.setdefault("state", {})[RATE] = resources.limits.admit(key)
        if refusal is not None:
            raise refusal
        if key is not None and needed is not OPEN and not key.role.may(needed):
            raise _role_insufficient(key, needed)
        return key


def holder_of(request: Request) -> ApiKey | None:
    """Return the key of a request; None where there are no keys."""
    key = request.scope["state"][_STATE]
    assert key is None or isinstance(key, ApiKey)
    return key


async def _holder(request: Request) -> ApiKey | None:
    return holder_of(request)


Holder = Annotated[ApiKey | None, Depends(_holder)]
"""The type of an endpoint's parameter that receives the key of the request; None where there are no keys."""


def check_owner(holder: ApiKey | None, key_id: str | None) -> None:
    """Make sure that the holder may cancel what was submitted with ``owner``.

    Raises
    ------
    ApiError
        403: it was another key's, and the role is below operate.
    """
    if holder is not None and holder.id != key_id and not holder.role.may(Role.OPERATE):
        raise _role_insufficient(holder, Role.OPERATE, "it was not submitted with this key; ")


def check_priority(holder: ApiKey | None, priority: int, pointer: str) -> None:
    """Make sure that the holder may choose a priority: only operators may go before all others.

    Raises
    ------
    ApiError
        403: it is positive, and the role is below operate.
    """
    if priority > 0 and holder is not None and not holder.role.may(Role.OPERATE):
        message = f"{priority}; -{HIGHEST_PRIORITY} to 0 are accepted from the role {holder.role}"
        raise _role_insufficient(
            holder,
            Role.OPERATE,
            "a positive priority goes before all other work; ",
            faults=[Fault(pointer, "role_insufficient", message)],
        )


def _role_insufficient(key: ApiKey, needed: Role, why: str = "", faults: Sequence[Fault] = ()) -> ApiError:
    detail = f"{why}the role {needed} is needed, and key {key.prefix} has the role {key.role}"
    return ApiError(
        HTTPStatus.FORBIDDEN,
        "role_insufficient",
        detail,
        faults=faults,
        extras={"needed_role": needed.value},
        headers={_CHALLENGE: 'Bearer error="insufficient_scope"'},
    )


async def _identify(headers: Headers, resources: Resources) -> ApiKey | None:
    """Return the key of a request; None where there are no keys and only this machine is served."""
    ring = resources.keys
    known = await ring.known()
    if not known.keys and resources.settings.is_loopback:
        _require_this_machine(headers.get("host"))
        return None
    text = _bearer(headers.get("authorization"))
    prefix = key_prefix(text)
    if prefix is not None and prefix not in known.keys:
        known = await ring.known(SECOND_LOOK_SECONDS)  # the key may have been created a moment ago
    key = None if prefix is None else known.keys.get(prefix)
    if key is None or not key.opens_with(text):
        raise _unauthorized("key_unknown", "this service has no such key")
    now = ring.now(known)
    if (standing := key.standing(now)) is not KeyStanding.LIVE:
        raise _unauthorized(f"key_{standing}", f"key {key.prefix} has {_PAST[standing]}; ask for a new one")
    ring.note_use(key)
    return key


def _require_this_machine(host: str | None) -> None:
    """Refuse a foreign host name that resolves to this machine: a web page must not read an open service."""
    if host is None or _names_this_machine(host):
        return
    detail = (
        f"without keys the service answers to 127.0.0.1, ::1 and localhost, not to {host!r}; "
        "`polhode keys create` makes a key"
    )
    raise ApiError(HTTPStatus.FORBIDDEN, "host_not_local", detail)


@lru_cache(maxsize=64)  # clients send the same few again and again
def _names_this_machine(host: str) -> bool:
    try:
        return is_this_machine(urlsplit(f"//{host}").hostname or "")
    except ValueError:
        return False


def _bearer(header: str | None) -> str:
    scheme, _, text = (header or "").strip().partition(" ")
    if scheme.lower() != "bearer" or not text:
        detail = "a key is needed: Authorization: Bearer plh_…; `polhode keys create` makes one"
        raise ApiError(
            HTTPStatus.UNAUTHORIZED, "key_missing", detail, headers={_CHALLENGE: 'Bearer realm="polhode"'}
        )
    return text.strip()


def _unauthorized(code: str, detail: str) -> ApiError:
    challenge = 'Bearer realm="polhode", error="invalid_token"'
    return ApiError(HTTPStatus.UNAUTHORIZED, code, detail, headers={_CHALLENGE: challenge})
