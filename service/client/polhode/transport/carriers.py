"""Carry out operations over httpx, in a thread or in an event loop."""

import asyncio
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, ExitStack
from typing import TypeVar

import httpx

from polhode.transport.steps import LostConnectionError, NextLine, Operation, Pause, Reply, Send, Step
from polhode.transport.terms import Terms

T = TypeVar("T")
CarrierT = TypeVar("CarrierT", bound="ThreadCarrier | LoopCarrier")
"""The carrier by which a client, and all that it returns, sends requests."""

_LOST = (httpx.TransportError, httpx.DecodingError, httpx.StreamError)
_HOPELESS = (httpx.UnsupportedProtocol, httpx.LocalProtocolError)
"""Errors that would come again if the request were sent again."""
_TIMEOUT = httpx.Timeout(90.0, connect=10.0)
"""Seconds without a byte: the service answers a waiting request within 60, and events come every 15."""


class ThreadCarrier:
    """Carries out operations in the calling thread."""

    def __init__(self, terms: Terms) -> None:
        self.terms = terms
        self._http = httpx.Client(base_url=terms.url, headers=terms.headers, timeout=_TIMEOUT)

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
                            streaming = self._http.stream(
                                step.method, step.path, headers=step.headers, content=step.content
                            )
                            response = stack.enter_context(streaming)
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
            case Send():
                response = self._http.request(
                    step.method, step.path, headers=step.headers, content=step.content
                )
                return _reply(response, response.content)

    def close(self) -> None:
        """Close the connections."""
        self._http.close()


class LoopCarrier:
    """Carries out operations in the running event loop."""

    def __init__(self, terms: Terms) -> None:
        self.terms = terms
        self._http = httpx.AsyncClient(base_url=terms.url, headers=terms.headers, timeout=_TIMEOUT)

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
                            streaming = self._http.stream(
                                step.method, step.path, headers=step.headers, content=step.content
                            )
                            response = await stack.enter_async_context(streaming)
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
            case Send():
                response = await self._http.request(
                    step.method, step.path, headers=step.headers, content=step.content
                )
                return _reply(response, response.content)

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()


async def _nothing() -> AsyncIterator[str]:
    for line in list[str]():
        yield line


def _reply(response: httpx.Response, content: bytes = b"") -> Reply:
    return Reply(response.status_code, {k.lower(): v for k, v in response.headers.items()}, content)


def _lost(fault: Exception) -> LostConnectionError:
    return LostConnectionError(str(fault) or type(fault).__name__)
