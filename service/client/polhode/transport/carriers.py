"""Carry out operations over httpx, in a thread or an event loop; connections belong to one of these."""

import asyncio
import os
import secrets
import ssl
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, ExitStack, suppress
from functools import cache
from pathlib import Path
from typing import Generic, Protocol, Self, TypeVar
from weakref import WeakSet

import httpx

from polhode.errors import PolhodeError, WrongArgumentError
from polhode.transport.terms import (
    LostConnectionError,
    NextLine,
    Operation,
    Pause,
    Reply,
    Send,
    Step,
    Terms,
    Together,
)

T = TypeVar("T")
CarrierT = TypeVar("CarrierT", bound="ThreadCarrier | LoopCarrier")
"""The carrier by which a client, and all that it returns, sends requests."""
HttpT = TypeVar("HttpT", bound=httpx.Client | httpx.AsyncClient)

_LOST = (httpx.TransportError, httpx.DecodingError, httpx.StreamError, LostConnectionError)
_HOPELESS = (httpx.UnsupportedProtocol, httpx.LocalProtocolError)
"""Errors that would come again if the request were sent again."""
_TIMEOUT = httpx.Timeout(90.0, connect=10.0)
"""Seconds without a byte: the service answers a waiting request within 60, and events come every 15."""
_ECHO = "Polhode-Echo"
"""Header with a random word, which the service returns as it was sent: no answer is taken for another's."""
_FOREIGN = "the answer was to another request"


class Leaving(Protocol):
    """An owner of something that belongs to one process."""

    def leave(self) -> None:
        """Give up, in a process that was just forked, what is the other's."""


_LEAVING: WeakSet[Leaving] = WeakSet()


def leave_at_forks(owner: Leaving) -> None:
    """Have something give up what is another process's, as long as it lives."""
    _watch_forks()
    _LEAVING.add(owner)


@cache
def _watch_forks() -> None:
    def leave() -> None:
        for each in list(_LEAVING):
            each.leave()

    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=leave)


class Pool(Generic[HttpT]):
    """The connections of one process, or of one event loop in it.

    Attributes
    ----------
    http
        Through which requests are sent.
    """

    def __init__(self, http: HttpT) -> None:
        self.http = http
        self.guard: AsyncIterator[None] | None = None
        """Closes the connections when its event loop ends."""
        self._sockets: WeakSet[object] = WeakSet()

    def remember(self, event: str, info: Mapping[str, object]) -> None:
        """Note the socket of a connection that was opened; httpx reports events by this signature."""
        if not event.endswith((".connect_tcp.complete", ".start_tls.complete")):
            return
        ask = getattr(info.get("return_value"), "get_extra_info", None)
        if ask is not None and (found := ask("socket")) is not None:
            # Of a loop's socket only a view is shown.
            self._sockets.add(getattr(found, "_sock", found))

    async def remember_soon(self, event: str, info: Mapping[str, object]) -> None:
        """Note it for an event loop."""
        self.remember(event, info)

    def abandon(self) -> None:
        """Close the sockets alone: the locks and the loop of the connections may be another process's."""
        for each in list(self._sockets):
            if (close := getattr(each, "close", None)) is not None:
                with suppress(OSError):
                    close()


class Connections(Generic[HttpT]):
    """The connections of one carrier: those of this process, and in it one pool for each event loop.

    A forked process has its parent's sockets, and both would read each other's answers. So a process that
    is not the one that opened them closes its copies, which the other side does not notice.

    Parameters
    ----------
    make
        Makes the client of httpx, without connections.
    """

    def __init__(self, make: Callable[[], HttpT]) -> None:
        self._make, self._is_closed = make, False
        self._process = os.getpid()
        self._pools: dict[asyncio.AbstractEventLoop | None, Pool[HttpT]] = {}
        self._left: list[Pool[HttpT]] = []
        leave_at_forks(self)

    def of(self, loop: asyncio.AbstractEventLoop | None = None) -> Pool[HttpT]:
        """Return the pool of this process, or of a loop in it.

        Raises
        ------
        PolhodeError
            The client is closed.
        """
        if self._is_closed:
            raise PolhodeError("this client is closed; connect() returns another one")
        if self._process != os.getpid():
            self.leave()
        if loop not in self._pools:
            for ended in [each for each in list(self._pools) if each is not None and each.is_closed()]:
                self._pools.pop(ended).abandon()
            return self._pools.setdefault(loop, Pool(self._make()))
        return self._pools[loop]

    def forget(self, loop: asyncio.AbstractEventLoop | None = None) -> None:
        """Send nothing by these connections again; others may still wait for answers by them."""
        self._pools.pop(loop, None)

    def leave(self) -> None:
        """Close this process's copies of another one's sockets, without a word to the other side."""
        for pool in self._pools.values():
            pool.abandon()
        # Never collected: they would call a loop, and take locks, of the other process.
        self._left += self._pools.values()
        self._pools, self._process = {}, os.getpid()

    def ended(self, loop: asyncio.AbstractEventLoop | None = None) -> HttpT | None:
        """Return what has to be closed in this loop, and open no more."""
        if self._process != os.getpid():
            self.leave()
        own = self._pools.pop(loop, None)
        for pool in self._pools.values():
            pool.abandon()
        self._pools, self._is_closed = {}, True
        return None if own is None else own.http


class ThreadCarrier:
    """Carries out operations in the calling thread."""

    def __init__(self, terms: Terms) -> None:
        self.terms = terms
        self.connections = Connections(lambda: _made(httpx.Client, terms))

    def run(self, steps: Operation[T]) -> T:
        """Return the operation's result; what it raises passes through."""
        with ExitStack() as stack:
            stack.callback(steps.close)
            lines: Iterator[str] = iter(())
            try:
                step = next(steps)
                while True:
                    try:
                        if isinstance(step, Send) and step.is_stream:
                            response = self._sent(step)
                            stack.callback(response.close)
                            lines, reply = response.iter_lines(), _reply(response)
                        else:
                            reply = self._done(step, lines)
                    except _HOPELESS:
                        raise
                    except _LOST as fault:
                        step = steps.throw(_lost(fault))
                    else:
                        step = steps.send(reply)
            except StopIteration as end:
                result: T = end.value
                return result

    def _done(self, step: Step, lines: Iterator[str]) -> Reply:
        match step:
            case Pause(seconds):
                time.sleep(seconds)
                return Reply()
            case NextLine():
                return Reply(line=next(lines, None))
            case Together(operations):
                self._together(operations)
                return Reply()
            case Send():
                response = self._sent(step)
                return _reply(response, response.content)

    def _sent(self, step: Send) -> httpx.Response:
        pool = self.connections.of()
        request = _request(pool.http, step, pool.remember)
        response = pool.http.send(request, stream=step.is_stream)
        if not _is_own(request, response):
            self.connections.forget()
            raise LostConnectionError(_FOREIGN)
        return response

    def _together(self, operations: Sequence[Operation[None]]) -> None:
        faults: list[BaseException] = []

        def work(each: Operation[None]) -> None:
            try:
                self.run(each)
            except BaseException as fault:
                faults.append(fault)

        # Daemons: a program that is interrupted does not wait for them.
        threads = [threading.Thread(target=work, args=(each,), daemon=True) for each in operations[1:]]
        for thread in threads:
            thread.start()
        for each in operations[:1]:
            self.run(each)
        for thread in threads:
            thread.join()
        for fault in faults:
            raise fault

    def close(self) -> None:
        """Close the connections."""
        if (http := self.connections.ended()) is not None:
            http.close()

    def __reduce__(self) -> "tuple[type[ThreadCarrier], tuple[Terms]]":
        return ThreadCarrier, (self.terms,)

    def __deepcopy__(self, memo: object) -> Self:
        return self


class LoopCarrier:
    """Carries out operations in the running event loop."""

    def __init__(self, terms: Terms) -> None:
        self.terms = terms
        self.connections = Connections(lambda: _made(httpx.AsyncClient, terms))

    async def run_soon(self, steps: Operation[T]) -> T:
        """Return the operation's result; what it raises passes through."""
        async with AsyncExitStack() as stack:
            stack.callback(steps.close)
            lines: AsyncIterator[str] = _nothing()
            try:
                step = next(steps)
                while True:
                    try:
                        if isinstance(step, Send) and step.is_stream:
                            response = await self._sent(step)
                            stack.push_async_callback(response.aclose)
                            lines, reply = response.aiter_lines(), _reply(response)
                        else:
                            reply = await self._done(step, lines)
                    except _HOPELESS:
                        raise
                    except _LOST as fault:
                        step = steps.throw(_lost(fault))
                    else:
                        step = steps.send(reply)
            except StopIteration as end:
                result: T = end.value
                return result

    async def _done(self, step: Step, lines: AsyncIterator[str]) -> Reply:
        match step:
            case Pause(seconds):
                await asyncio.sleep(seconds)
                return Reply()
            case NextLine():
                return Reply(line=await anext(lines, None))
            case Together(operations):
                await asyncio.gather(*map(self.run_soon, operations))
                return Reply()
            case Send():
                response = await self._sent(step)
                return _reply(response, response.content)

    async def _sent(self, step: Send) -> httpx.Response:
        loop = asyncio.get_running_loop()
        pool = self.connections.of(loop)
        if pool.guard is None:
            pool.guard = _closed_with_its_loop(pool.http)
            await anext(pool.guard)
        request = _request(pool.http, step, pool.remember_soon)
        response = await pool.http.send(request, stream=step.is_stream)
        if not _is_own(request, response):
            self.connections.forget(loop)
            raise LostConnectionError(_FOREIGN)
        return response

    async def close(self) -> None:
        """Close the connections."""
        if (http := self.connections.ended(asyncio.get_running_loop())) is not None:
            await http.aclose()

    def __reduce__(self) -> "tuple[type[LoopCarrier], tuple[Terms]]":
        return LoopCarrier, (self.terms,)

    def __deepcopy__(self, memo: object) -> Self:
        return self


async def _closed_with_its_loop(http: httpx.AsyncClient) -> AsyncIterator[None]:
    # asyncio.run ends the generators that wait in its loop; another loop could not close the connections.
    try:
        yield
    finally:
        await http.aclose()


async def _nothing() -> AsyncIterator[str]:
    for line in list[str]():
        yield line


def _request(
    http: httpx.Client | httpx.AsyncClient, step: Send, trace: Callable[..., object]
) -> httpx.Request:
    headers = {**step.headers, _ECHO: secrets.token_hex(8)}
    return http.build_request(
        step.method, step.path, headers=headers, content=step.content, extensions={"trace": trace}
    )


def _is_own(request: httpx.Request, response: httpx.Response) -> bool:
    """Tell whether an answer is that to a request; one without the word may be, from an older service."""
    sent = request.headers[_ECHO]
    return bool(response.headers.get(_ECHO, sent) == sent)


def _reply(response: httpx.Response, content: bytes = b"") -> Reply:
    return Reply(response.status_code, {k.lower(): v for k, v in response.headers.items()}, content)


def _lost(fault: Exception) -> LostConnectionError:
    return LostConnectionError(str(fault) or type(fault).__name__)


def _made(kind: Callable[..., HttpT], terms: Terms) -> HttpT:
    """Return a pool without connections; httpx does not read the environment, whose faults are told here."""
    try:
        return kind(
            base_url=terms.url,
            headers=terms.headers,
            timeout=_TIMEOUT,
            trust_env=False,
            proxy=None if terms.proxy is None else terms.proxy.address,
            verify=_certificates(terms),
        )
    except (ImportError, ValueError, httpx.InvalidURL) as fault:
        if terms.proxy is None:
            raise WrongArgumentError(f"{terms.url} is no address: {fault}") from fault
        what = f"cannot be used ({fault}); http://, https:// and socks5:// with a host are accepted"
        if isinstance(fault, ImportError):
            what = "needs socksio: pip install 'polhode-client[socks]'"
        raise WrongArgumentError(
            f"{terms.proxy} {what}. Hosts in NO_PROXY are asked without a proxy"
        ) from fault


def _certificates(terms: Terms) -> ssl.SSLContext:
    if terms.proxy is None and terms.url.startswith("http:"):
        # Without authorities: reading them takes longer than asking.
        return ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    given = {name: os.environ.get(name) for name in ("SSL_CERT_FILE", "SSL_CERT_DIR")}
    for name, path in given.items():
        if path and not Path(path).exists():
            raise WrongArgumentError(
                f"there is no {path}, which {name} names; certificates in PEM are accepted"
            )
    file, folder = (path or None for path in given.values())
    if file is None and folder is None:
        return httpx.create_ssl_context(trust_env=False)
    try:
        return ssl.create_default_context(cafile=file, capath=folder)
    except OSError as fault:
        raise WrongArgumentError(
            f"SSL_CERT_FILE={file}: {fault}; certificates in PEM are accepted"
        ) from fault
