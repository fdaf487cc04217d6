"""Bridges between the database and a real Dask cluster, of which parts die, stall and start anew."""

import contextlib
import json
import signal
import subprocess
import sys

import numpy as np
import pytest
from distributed import Client

from service.jobs.records import AttemptOutcome, JobKind, JobState
from service.local.workers import this_host
from service.sandbox import Sandbox, SandboxCrashError
from service.storage.codecs.packing import SOLVED, ChunkPoints, chunk_outcome, decode_points
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.upkeep.presence import WorkerRegistry
from tests.support.dask_cluster import Cluster, Network, kill_group
from tests.support.waiting import is_alive, wait_until
from tests.workers.chores import SOURCE
from tests.workers.process.together import LIMITS
from tests.workers.processes import ROOT
from workers.process.cluster import DaskPool
from workers.process.dask_worker import TOPIC
from workers.process.messages import MessageError, outcomes_in, pack_outcomes, unpack
from workers.process.pool import ChildrenPool, ReturnedError
from workers.process.tasks import TASKS

pytestmark = pytest.mark.any_database
HOUR = 3600.0


@pytest.fixture(scope="module")
def own_cluster(tmp_path_factory):
    """A cluster of two workers, which tests of this module kill and start again."""
    cluster = Cluster(tmp_path_factory.mktemp("own"), workers=2)
    yield cluster
    cluster.close()


def start(pool, *problems):
    calls = [({"job": str(number)}, (json.dumps(problem),)) for number, problem in enumerate(problems)]
    return pool.start(JobKind.SOLVE, calls, seconds=HOUR, turn_seconds=HOUR)


def begun(log):
    return log.read_text().split() if log.exists() else []


def finished(jobs, submitted):
    wait_until(lambda: all(jobs.get(job.id).is_finished for job in submitted))
    return [jobs.get(job.id) for job in submitted]


def outcomes(jobs, job):
    return [attempt.outcome for attempt in jobs.attempts(job.id)]


def test_a_bridge_computes_jobs_and_sweeps_and_says_where(
    database, jobs, own_cluster, start_worker, tmp_path
):
    submitted = [jobs.submit({"number": number}, str(number)) for number in range(40)]
    sweep = SweepStore(database).submit({"seconds": 0.02}, points=300, most=30)
    bridge = start_worker(pool="dask", dask_scheduler=own_cluster.file, lease_seconds=10.0)
    assert {job.state for job in finished(jobs, submitted)} == {JobState.SUCCEEDED}
    assert {tuple(outcomes(jobs, job)) for job in submitted} == {(AttemptOutcome.SUCCEEDED,)}
    sweeps = SweepStore(database)
    wait_until(lambda: sweeps.get(sweep.id).finished_at is not None)
    chunks = list(sweeps.chunks(sweep.id))
    assert [index for each in chunks for index in range(each.first, each.first + each.count)] == list(
        range(300)
    )
    points = [decode_points(data) for data in sweeps.data(sweep.id, [chunk.first for chunk in chunks])]
    assert [value for found in points for value in found.numbers["period"]] == list(range(300))
    provenance = {name: value for name, value in SOURCE.items() if name != "host"}
    assert sweeps.get(sweep.id).provenances == [{**provenance, "hosts": [SOURCE["host"]]}]
    registry = WorkerRegistry(database, lease_seconds=10.0)
    (cluster,) = wait_until(lambda: [each for each in registry.clusters() if each.workers == 2])
    assert (cluster.scheduler, cluster.is_connected, cluster.threads) == (str(own_cluster.file), True, 2)
    assert cluster.left_out == ()
    job = jobs.submit({"chore": "spin", "log": str(tmp_path / "log")}, "cancelled")
    (child,) = wait_until(lambda: begun(tmp_path / "log"))
    jobs.cancel(job.id)
    wait_until(lambda: not is_alive(child))
    assert bridge.terminate() == 0


def test_a_worker_that_is_killed_costs_what_had_begun_one_attempt(own_cluster, connected, tmp_path):
    pool, log = connected(own_cluster, places=2), tmp_path / "log"
    long = [start(pool, {"chore": "sleep", "seconds": HOUR, "log": str(log)}) for _ in range(2)]
    wait_until(lambda: len(begun(log)) == 2 and all(batch.begun == 1 for batch in long))
    children = begun(log)
    kill_group(own_cluster.workers.pop())
    lost = wait_until(lambda: [batch for batch in long if batch.has_ended])
    assert len(lost) == 1
    with pytest.raises(SandboxCrashError):
        lost[0].outcomes()
    # Its child ends with it, and the other one with its batch, whoever ends it.
    wait_until(lambda: sum(is_alive(child) for child in children) == 1)
    for batch in long:
        batch.kill()
    wait_until(lambda: not any(is_alive(child) for child in children))
    assert len(begun(log)) == 2  # Dask has not run it again
    own_cluster.start_worker()


def test_the_children_of_a_bridge_that_died_stop(own_cluster, connected, tmp_path):
    connected(own_cluster)
    log = tmp_path / "log"
    code = f"""
import json, time
from service.jobs.records import JobKind
from workers.process.cluster import DaskPool
pool = DaskPool({own_cluster.address!r}, "tests.workers.chores:TASKS", memory_mb={LIMITS.memory_mb},
                silent_seconds=60)
while not pool.places():
    time.sleep(0.05)
call = json.dumps({{"chore": "spin", "log": {str(log)!r}}})
pool.start(JobKind.SOLVE, [({{}}, (call,))], seconds=3600, turn_seconds=3600)
time.sleep(3600)
"""
    bridge = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT)
    try:
        (child,) = wait_until(lambda: begun(log))
    finally:
        bridge.kill()
        bridge.wait()
    wait_until(lambda: not is_alive(child))


def test_a_worker_that_is_silent_is_given_up_and_used_again_when_it_goes_on(own_cluster, connected, tmp_path):
    pool, log = connected(own_cluster, places=2, silent_seconds=5.0), tmp_path / "log"
    batches = [start(pool, {"chore": "sleep", "seconds": HOUR, "log": str(log)}) for _ in range(2)]
    wait_until(lambda: all(batch.begun == 1 for batch in batches))
    (own_cluster.workers[0]).send_signal(signal.SIGSTOP)
    try:
        wait_until(lambda: pool.cluster().workers == 1)
        (lost,) = wait_until(lambda: [batch for batch in batches if batch.has_ended])
        with pytest.raises(SandboxCrashError, match="silent"):
            lost.outcomes()
    finally:
        own_cluster.workers[0].send_signal(signal.SIGCONT)
    wait_until(lambda: pool.cluster().workers == 2)
    for batch in batches:
        batch.kill()
    # What it went on with is stopped, too: nobody wants it.
    wait_until(lambda: not any(is_alive(child) for child in begun(log)))


def test_a_network_that_stalls_costs_nobody_an_attempt(own_cluster, connected, tmp_path):
    network, log = Network(own_cluster.address), tmp_path / "log"
    with contextlib.closing(network):
        pool = connected(network, places=2, silent_seconds=5.0)
        batches = [start(pool, {"chore": "sleep", "seconds": HOUR, "log": str(log)}) for _ in range(2)]
        wait_until(lambda: all(batch.begun == 1 for batch in batches))
        network.stall()
        wait_until(lambda: all(batch.has_ended for batch in batches))
        for batch in batches:
            with pytest.raises(ReturnedError):
                batch.outcomes()
        assert not pool.cluster().is_connected
        network.resume()
        wait_until(lambda: pool.cluster().workers == 2)
        wait_until(lambda: not any(is_alive(child) for child in begun(log)))
        after = start(pool, {})
        wait_until(lambda: after.has_ended)
        assert len(after.outcomes()) == 1
        pool.close()


def test_a_worker_that_retires_costs_nobody_an_attempt(own_cluster, connected, tmp_path):
    pool, log = connected(own_cluster, places=2), tmp_path / "log"
    batches = [start(pool, {"chore": "sleep", "seconds": HOUR, "log": str(log)}) for _ in range(2)]
    wait_until(lambda: all(batch.begun == 1 for batch in batches))
    with Client(own_cluster.address, set_as_default=False) as client:
        client.retire_workers([pool._at_work[batches[0].key].address])
        wait_until(lambda: batches[0].has_ended)
    with pytest.raises(ReturnedError):
        batches[0].outcomes()
    batches[1].kill()
    own_cluster.start_worker()
    wait_until(lambda: pool.cluster().workers == 2)
    wait_until(lambda: not any(is_alive(child) for child in begun(log)))


def test_a_worker_of_another_version_is_left_out_and_says_why(own_cluster, connected):
    pool = connected(own_cluster, places=2)
    with Client(own_cluster.address, set_as_default=False) as client:
        client.log_event(TOPIC, {
            "worker": "tcp://elsewhere:1", "incarnation": "x", "threads": 8, "is_ready": True, "fault": None,
            "begun": {}, "stopped": {}, "equipment": {**pool._ours, "numerics": -1},
        })  # fmt: skip
        client.log_event(TOPIC, {"worker": "tcp://nonsense:1"})
    (left_out,) = wait_until(lambda: pool.cluster().left_out)
    assert left_out.worker == "tcp://elsewhere:1"
    assert "its numerics is -1, and here it is" in left_out.why
    assert pool.cluster().threads == 2


def test_two_bridges_share_a_cluster(own_cluster, connected):
    first, second = connected(own_cluster, places=2), connected(own_cluster, places=2)
    batches = [start(pool, {"number": k}) for k in range(10) for pool in (first, second)]
    wait_until(lambda: all(batch.has_ended for batch in batches))
    assert all(len(batch.outcomes()) == 1 for batch in batches)


@pytest.mark.long
def test_a_scheduler_that_is_started_anew_costs_nobody_an_attempt(own_cluster, connected, tmp_path):
    pool, log = connected(own_cluster, places=2), tmp_path / "log"
    batch = start(pool, {"chore": "sleep", "seconds": HOUR, "log": str(log)})
    wait_until(lambda: batch.begun == 1)
    kill_group(own_cluster.scheduler)
    wait_until(lambda: batch.has_ended)
    with pytest.raises(ReturnedError):
        batch.outcomes()
    wait_until(lambda: not pool.cluster().is_connected)
    late = start(pool, {})
    with pytest.raises(ReturnedError):
        late.outcomes()
    # Dask's workers end with their scheduler; whoever runs them starts them again.
    for worker in own_cluster.workers:
        kill_group(worker)
    own_cluster.workers.clear()
    own_cluster.start_scheduler()
    own_cluster.start_worker()
    wait_until(lambda: pool.cluster().workers == 1)
    after = start(pool, {})
    wait_until(lambda: after.has_ended)
    assert len(after.outcomes()) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"host": "h" * 256}, {"way": "its own"}, {"numerics": "12"}, {"hosts": []}, {"processor": "x" * 5000},
    ],
)  # fmt: skip
def test_a_source_that_is_none_is_refused(change):
    assert read_back(SOURCE).source == SOURCE
    with pytest.raises(MessageError):
        read_back({**SOURCE, **change})


def read_back(source):
    outcome = chunk_outcome(ChunkPoints([SOLVED], {"period": np.ones(1)}), 1.0, source)
    data = pack_outcomes({"begun": 1, "seconds": 1.0}, [outcome])
    return outcomes_in(unpack(data), JobKind.CHUNK, 1)[0]


@pytest.mark.long
def test_a_cluster_computes_the_bits_of_children_here(tmp_path):
    problem = json.loads((ROOT / "examples" / "first.json").read_text())
    axis = {"pointer": "/motion/lambda", "values": [f"{k}/20" for k in range(20, 40)]}
    sweep = {"base": problem, "axes": [axis], "keep": ["period", "energy", "error"]}
    chunk = {"sweep": sweep, "first": 0, "count": 20, "way": "compiled"}
    memory_mb, found = 2048, []
    cluster = Cluster(tmp_path)
    sandbox = Sandbox(1, memory_mb=memory_mb, preload=TASKS.modules())
    dask = DaskPool(cluster.address, TASKS.name, memory_mb=memory_mb, silent_seconds=HOUR)
    try:
        wait_until(lambda: dask.places() >= 1)
        for pool in (ChildrenPool(sandbox, TASKS.computations, slots=1), dask):
            for kind, document in ((JobKind.SOLVE, problem), (JobKind.CHUNK, chunk)):
                batch = pool.start(kind, [({}, (json.dumps(document),))], seconds=HOUR, turn_seconds=0.0)
                wait_until(lambda batch=batch: batch.has_ended)
                found += batch.outcomes()
    finally:
        dask.close()
        sandbox.close()
        cluster.close()
    solved, points, solved_there, points_there = found
    assert (solved_there.dense, solved_there.samples) == (solved.dense, solved.samples)
    told, told_there = (json.loads(json.dumps(each.summary)) for each in (solved, solved_there))
    for each in (told, told_there):
        each.pop("cost")  # what was measured
        each["provenance"].pop("threads")  # the fork server of tests has not been told to use one
    assert told_there == told
    assert (points_there.data, points_there.bounds) == (points.data, points.bounds)
    # Solutions and points of one host tell the same of it.
    for solution, chunk in ((solved, points), (solved_there, points_there)):
        named = {**solution.summary["provenance"], "host": this_host()}
        assert chunk.source == {**named, "threads": chunk.source["threads"]}


REFUSING = """
import pickle, threading
from workers.process.messages import refuse_pickles
refuse_pickles()
assert pickle.loads(pickle.dumps({"a": [1.0, b"x"], "kind": bytes}))["kind"] is bytes
from distributed.protocol import dumps, loads, to_serialize
assert bytes(loads(dumps({"reply": to_serialize(b"reply")}))["reply"]) == b"reply"
for message in (pickle.dumps(print), dumps({"reply": to_serialize(threading.Event)})):
    try:
        pickle.loads(message) if isinstance(message, bytes) else loads(message)
    except ValueError as fault:
        print("refused", type(fault).__name__)
"""


@pytest.mark.long
def test_a_bridge_unpickles_nothing_but_bytes():
    done = subprocess.run([sys.executable, "-c", REFUSING], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.split() == ["refused", "MessageError"] * 2, done.stderr[-2000:]
