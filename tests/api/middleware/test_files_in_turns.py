"""Requests for files wait for each other, and nobody waits for them."""

import asyncio
from dataclasses import dataclass, field

import pytest

from service.api.middleware.heavy_answers import FilesInTurns

CROWD = 50


@dataclass
class Application:
    """Begins no answer before ``may_begin``, and ends none before ``may_end``."""

    may_begin: asyncio.Event = field(default_factory=asyncio.Event)
    may_end: asyncio.Event = field(default_factory=asyncio.Event)
    inside: int = 0
    most: int = 0
    fails: bool = False

    async def __call__(self, scope, receive, send):
        if scope["path"] == "/v1/jobs":
            return
        self.inside += 1
        self.most = max(self.most, self.inside)
        await self.may_begin.wait()
        self.inside -= 1
        if self.fails:
            raise RuntimeError
        await send({"type": "http.response.start"})
        await self.may_end.wait()


async def nothing(*_):
    """Receives and sends nothing."""


def request(path, **further):
    return {"type": "http", "path": path, **further}


async def settle():
    for _ in range(5 * CROWD):
        await asyncio.sleep(0)


@pytest.mark.parametrize(
    "scope",
    [request("/static/page/1/plotly.min.js"), request("/openapi.json"), request("/p/docs", root_path="/p")],
)
def test_few_files_begin_at_once_and_others_pass(scope):
    async def run():
        inner = Application()
        outer = FilesInTurns(inner)
        crowd = [asyncio.create_task(outer(scope, nothing, nothing)) for _ in range(CROWD)]
        await settle()
        assert inner.inside == inner.most < 10
        # A request that is no file is through while all files wait.
        await outer(request("/v1/jobs"), nothing, nothing)
        inner.may_begin.set()
        await settle()
        # All have begun, though no client has read its answer to the end.
        assert inner.inside == 0
        assert not any(each.done() for each in crowd)
        inner.may_end.set()
        await asyncio.gather(*crowd)

    asyncio.run(run())


def test_an_answer_that_fails_before_it_begins_leaves_its_place():
    async def run():
        inner = Application(fails=True)
        inner.may_begin.set()
        outer = FilesInTurns(inner)
        answers = (outer(request("/docs"), nothing, nothing) for _ in range(CROWD))
        faults = await asyncio.gather(*answers, return_exceptions=True)
        assert [type(each) for each in faults] == [RuntimeError] * CROWD

    asyncio.run(run())
