"""Clients in other processes and event loops: each has connections of its own, and its own answers."""

import asyncio
import copy
import json
import multiprocessing
import os
import pickle  # noqa: TID251 - as process pools do
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import pytest

import polhode as ph
from tests.client.test_local import answers
from tests.support.waiting import wait_until

LAMBDAS = ["60/97", "66/97", "70/97", "77/97", "86/97", "92/97", "103/97", "110/97"]

FORKED = """
import asyncio, contextlib, json, multiprocessing, os, sys
import polhode as ph
from polhode.transport.exchange import follow

base, lambdas, rounds = json.loads(sys.argv[1]), json.loads(sys.argv[2]), int(sys.argv[3])
client, later = ph.connect(cache=False), ph.connect_async(cache=False)

def solved(lam):
    motion = client.solve(base, lam=lam)
    ended = {"solution": client.submit(base, lam=lam).wait().id}
    if lam in lambdas[:2]:
        # The end as an event, by a stream of its own.
        job = client.submit(base, lam=lam)
        ended = client.carrier.run(follow(client.carrier.terms, f"/v1/jobs/{job.id}", {"state": "queued"}))
    return motion.problem["motion"]["lambda"], float(motion.period), ended["solution"] == motion.id

def solved_in_a_loop(lam):
    async def work():
        motion = await later.solve(base, lam=lam)
        job = await later.submit(base, lam=lam)
        return motion.problem["motion"]["lambda"], float(motion.period), (await job.wait()).id == motion.id

    return asyncio.run(work())

def sockets(_=None):
    with open("/proc/net/tcp") as listed:
        connected = {f"socket:[{line.split()[9]}]" for line in list(listed)[1:]}
    mine = set()
    for each in os.listdir("/proc/self/fd"):
        with contextlib.suppress(FileNotFoundError):  # closed since, as the listing itself is
            mine.add(os.readlink(f"/proc/self/fd/{each}"))
    return connected & mine

async def main():
    # Within a loop whose connections are open: all that a fork can take with it.
    alone = [solved(lam) for lam in lambdas]
    for lam in lambdas[:2]:
        await later.solve(base, lam=lam)
    for _ in range(rounds):
        with multiprocessing.get_context("fork").Pool(4) as pool:
            assert not any(here & sockets() for here in pool.map(sockets, range(4), chunksize=1))
            assert pool.map(solved, lambdas, chunksize=1) == alone
            assert pool.map(solved_in_a_loop, lambdas, chunksize=1) == alone
        assert [solved(lam) for lam in lambdas] == alone
    return alone

print(json.dumps(asyncio.run(main())))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes cannot be forked here")
@pytest.mark.parametrize("rounds", [1, pytest.param(50, marks=pytest.mark.long)])
def test_forked_processes_have_answers_of_their_own(connected, base, rounds):
    arguments = [json.dumps(base), json.dumps(LAMBDAS), str(rounds)]
    program = subprocess.run(
        [sys.executable, "-c", FORKED, *arguments], capture_output=True, text=True, check=False, timeout=1200
    )
    assert program.returncode == 0, program.stderr
    found = json.loads(program.stdout)
    assert [lam for lam, _, _ in found] == LAMBDAS
    for lam, period, is_same in found:
        motion = connected.solve(base, lam=lam)
        assert (period, is_same) == (float(motion.period), True)


LIVING = """
import os, sys, time, polhode as ph
c = ph.local(workers=0)
child = os.fork()
if child == 0:
    c.close()  # no end of the service: it is the other's
    while True:
        time.sleep(60)
c.jobs().count()
print(c.url, child, flush=True)
sys.stdin.read()
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes cannot be forked here")
def test_a_service_of_ones_own_ends_though_a_forked_process_lives_on():
    program = subprocess.Popen(
        [sys.executable, "-c", LIVING], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with program:
        url, child = program.stdout.readline().split()
        try:
            assert answers(url)
            program.kill()
            wait_until(lambda: not answers(url))
        finally:
            os.kill(int(child), 9)


ASKED = {
    "motion": lambda motion: (motion.id, motion.at([0.0, 1e6]).gamma.tolist()),
    "job": lambda job: (job.id, job.wait().id),
    "sweep": lambda sweep: (sweep.id, sweep.values("period").tolist()),
    "judgement": lambda judgement: (judgement.verdict, judgement.latex()["h"]),
    "listing": lambda listing: listing.count() > 0,
    "list": lambda listed: [motion.id for motion in listed.wait()],
    "atlas": lambda atlas: atlas.svg(),
    "client": lambda client: client.url,
    "solve": lambda solve: solve.__self__.url,
}


def asked(name: str, thing: object) -> object:
    """Ask a thing what it knows, in whatever process this is."""
    return ASKED[name](thing)


@pytest.fixture
def things(connected, base):
    motion = connected.solve(base)
    return {
        "motion": motion,
        "job": connected.submit(base),
        "sweep": connected.sweep(base, lam=[1, "3/2"], keep=["period"]),
        "judgement": connected.judge("a*g1", body=(2, 1), a=-1),
        "listing": connected.solutions(f"id={motion.id}"),
        "list": connected.submit_all([base]),
        "atlas": connected.atlas("a*g1", body=(2, 1), lam=(1, 2), samples=9, a=-1),
        "client": connected,
        "solve": connected.solve,
    }


def test_all_that_a_client_returns_goes_to_other_processes(things):
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        here = {name: asked(name, thing) for name, thing in things.items()}
        there = {name: pool.submit(asked, name, thing) for name, thing in things.items()}
        assert {name: each.result(120) for name, each in there.items()} == here
    for name, thing in things.items():
        assert asked(name, copy.deepcopy(thing)) == here[name]
    assert copy.deepcopy(things["motion"]).carrier is things["motion"].carrier


def test_a_pickle_never_has_a_key(monkeypatch):
    secret = "plh_secret"
    with ph.connect("http://127.0.0.1:9", secret) as client:
        with pytest.raises(ph.WrongArgumentError, match="POLHODE_KEY"):
            pickle.dumps(client)
        assert copy.deepcopy(client).carrier.terms.key == secret
        monkeypatch.setenv("POLHODE_KEY", secret)
        packed = pickle.dumps(client)
        assert secret.encode() not in packed
        monkeypatch.setenv("POLHODE_KEY", "plh_another")
        assert pickle.loads(packed).carrier.terms.key == "plh_another"


@pytest.mark.parametrize(
    "error",
    [
        ph.RefusedError(
            422, {"type": "urn:x:invalid", "errors": [{"pointer": "/a", "code": "c", "message": "m"}]}
        ),
        ph.MissingError(404, {"detail": "none"}),
        ph.FailedError({"id": "x", "error": {"code": "accuracy_not_met", "pointer": "/accuracy"}}),
        ph.SomeFailedError({3: ph.WrongArgumentError("no")}, {0: "a motion"}),
        ph.UnreachableError("no answer"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_come_back_from_other_processes(error):
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is type(error)
    assert str(back) == str(error)
    assert {name: str(each) for name, each in vars(back).items()} == {
        name: str(each) for name, each in vars(error).items()
    }


def test_an_asynchronous_client_is_used_in_one_loop_after_another(connected, base):
    client = ph.connect_async(cache=False)
    expected = connected.solve(base).id

    async def solved():
        return (await client.solve(base)).id

    async def twice():
        return await asyncio.gather(solved(), solved())

    # Two loops at once, and one after another.
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(lambda _: asyncio.run(twice()), range(4))) == [[expected] * 2] * 4
    for _ in range(3):
        assert asyncio.run(solved()) == expected

    async def closed():
        await client.close()
        with pytest.raises(ph.PolhodeError, match="closed"):
            await client.solve(base)

    asyncio.run(closed())
