"""Clients in other processes and event loops: each has connections of its own, and its own answers."""

import json
import os
import subprocess
import sys

import pytest

from tests.client.test_local import answers
from tests.workers.processes import wait_until

LAMBDAS = ["60/97", "66/97", "70/97", "77/97", "86/97", "92/97", "103/97", "110/97"]

FORKED = """
import asyncio, json, multiprocessing, os, sys
import polhode as ph

base, lambdas, rounds = json.loads(sys.argv[1]), json.loads(sys.argv[2]), int(sys.argv[3])
client, later = ph.connect(cache=False), ph.connect_async(cache=False)

def solved(lam):
    motion = client.solve(base, lam=lam)
    job = client.submit(base, lam=lam)
    # Followed by events, a stream of its own.
    return motion.problem["motion"]["lambda"], float(motion.period), job.wait().id == motion.id

def solved_in_a_loop(lam):
    motion = asyncio.run(later.solve(base, lam=lam))
    return motion.problem["motion"]["lambda"], float(motion.period), True

def sockets(_=None):
    with open("/proc/net/tcp") as listed:
        connected = {f"socket:[{line.split()[9]}]" for line in list(listed)[1:]}
    links = (f"/proc/self/fd/{each}" for each in os.listdir("/proc/self/fd"))
    return connected & {os.readlink(each) for each in links if os.path.islink(each)}

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
