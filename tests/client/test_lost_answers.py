"""Whatever answer gets lost, and wherever, the caller does not notice, and nothing is made twice."""

import itertools

import httpx
import pytest

import polhode as ph


class Losing(httpx.BaseTransport):
    """Passes requests on, and loses the n-th of them, its answer, or the half of its answer."""

    def __init__(self, inner: httpx.BaseTransport, number: int, how: str) -> None:
        self._inner, self._number, self._how = inner, number, how
        self.sent = 0

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        self.sent += 1
        is_lost = self.sent == self._number
        if is_lost and self._how == "not sent":
            raise httpx.ConnectError("refused")
        if is_lost and self._how == "busy":
            return httpx.Response(503, headers={"Retry-After": "0"}, json={"title": "busy"})
        response = self._inner.handle_request(request)
        if is_lost:
            content = response.read()
            if self._how == "no answer":
                raise httpx.ReadError("reset")
            return httpx.Response(response.status_code, headers=response.headers, stream=_Torn(content))
        return response

    def close(self) -> None:
        self._inner.close()


class _Torn(httpx.SyncByteStream):
    def __init__(self, content: bytes) -> None:
        self._content = content

    def __iter__(self):
        yield self._content[: len(self._content) // 2]
        raise httpx.RemoteProtocolError("peer closed connection without sending complete message body")


def work(client, base):
    """Return what somebody sees who solves, sweeps and takes frames."""
    motion = client.solve(base)
    sweep = client.sweep(base, lam=[1, "3/2"], keep=["period"])
    return motion, motion.frame(), sweep, sweep.frame()


@pytest.mark.parametrize(
    "how",
    ["no answer", "torn", *(pytest.param(each, marks=pytest.mark.long) for each in ("not sent", "busy"))],
)
def test_any_answer_may_get_lost(service, base, how, tmp_path):
    with ph.connect(service.address) as undisturbed:
        undisturbed.solve(base)
        for number in itertools.count(1):
            before = undisturbed.sweeps().count(), undisturbed.jobs().count()
            with ph.connect(service.address, cache=tmp_path / f"{number}") as client:
                http = client.carrier.connections.of().http
                losing = http._transport = Losing(http._transport, number, how)
                motion, samples, sweep, points = work(client, base)
            made = undisturbed.sweeps().count(), undisturbed.jobs().count()
            # One job, that of the motion, and one sweep: whatever was sent again.
            assert made == (before[0] + 1, before[1] + 1)
            assert (len(samples), len(points), len(sweep)) == (11, 2, 2)
            assert points.period[0] == pytest.approx(
                float(motion.period), abs=1e-8
            )  # 10 times both tolerances
            if losing.sent < number:
                break
    assert number > 5


def test_a_wrong_address_is_told_and_not_waited_for_long():
    told = r"127.0.0.1:9 has not answered .* POLHODE_URL"
    with (
        ph.connect("http://127.0.0.1:9", patience=0.2) as client,
        pytest.raises(ph.UnreachableError, match=told),
    ):
        client.solution("x")
    with pytest.raises(ph.WrongArgumentError, match="no address"):
        ph.connect("localhost:8000")
