"""The end of a job is heard of by events; where there are none, by asking."""

import json

import pytest

from polhode.transport.exchange import follow
from polhode.transport.terms import LostConnectionError, NextLine, Pause, Reply, Terms

PATH = "/v1/jobs/x"
EVENTS = {"content-type": "text/event-stream; charset=utf-8"}


def event(state: str) -> list[str]:
    return ["event: job", "id: 40d9", f"data: {json.dumps({'id': 'x', 'state': state})}", ""]


class Played:
    """A service that plays a script: heads of streams, their lines, and states of the job when asked."""

    def __init__(self, heads, lines, states) -> None:
        self.heads, self.lines, self.states = iter(heads), iter(lines), iter(states)
        self.asked: list[str] = []

    def carry_out(self, steps):
        step = next(steps)
        try:
            while True:
                match step:
                    case Pause():
                        step = steps.send(Reply())
                    case NextLine():
                        line = next(self.lines, None)
                        step = (
                            steps.throw(line) if isinstance(line, Exception) else steps.send(Reply(line=line))
                        )
                    case _:
                        self.asked.append(step.path)
                        step = steps.send(self._answer(step))
        except StopIteration as end:
            return end.value

    def _answer(self, step) -> Reply:
        if step.is_stream:
            return next(self.heads)
        return Reply(200, {}, json.dumps({"id": "x", "state": next(self.states)}).encode())


@pytest.fixture
def terms():
    return Terms("http://127.0.0.1:9")


def test_events_tell_the_end_without_asking(terms):
    lines = [": polhode", "retry: 2000", "", *event("running"), ": still here", "", *event("succeeded")]
    played = Played([Reply(200, EVENTS)], lines, ["queued"])
    assert played.carry_out(follow(terms, PATH))["state"] == "succeeded"
    assert played.asked == [PATH, f"{PATH}/events"]


def test_a_stream_that_breaks_is_opened_again_after_asking(terms):
    broken = [*event("running"), LostConnectionError("reset")]
    played = Played([Reply(200, EVENTS)] * 2, [*broken, *event("failed")], ["queued", "running"])
    assert played.carry_out(follow(terms, PATH))["state"] == "failed"
    assert played.asked == [PATH, f"{PATH}/events"] * 2


@pytest.mark.parametrize("head", [Reply(404), Reply(406), Reply(200, {"content-type": "text/html"})], ids=str)
def test_without_events_it_asks_and_does_not_try_again(terms, head):
    played = Played([head], [], ["queued", "running", "running", "succeeded"])
    assert played.carry_out(follow(terms, PATH))["state"] == "succeeded"
    assert played.asked == [PATH, f"{PATH}/events", PATH, PATH, PATH]


def test_a_busy_service_may_have_events_later(terms):
    played = Played([Reply(503), Reply(200, EVENTS)], event("succeeded"), ["queued", "running"])
    assert played.carry_out(follow(terms, PATH))["state"] == "succeeded"
    assert terms.has_events
