import pytest

from service.sandbox import Sandbox
from tests.support.dask_cluster import Cluster, Network
from tests.support.waiting import wait_until
from tests.workers.chores import CHORES, TASKS
from tests.workers.process.together import LIMITS
from workers.process.cluster import DaskPool
from workers.process.pool import ChildrenPool


@pytest.fixture
def sandbox():
    sandbox = Sandbox(1, memory_mb=LIMITS.memory_mb)
    sandbox.start()
    yield sandbox
    sandbox.close()


@pytest.fixture(scope="session")
def cluster(tmp_path_factory):
    """A scheduler and one worker with one thread; tests that kill them have their own."""
    cluster = Cluster(tmp_path_factory.mktemp("cluster"))
    yield cluster
    cluster.close()


@pytest.fixture
def connected():
    """Connect to clusters, and wait until they have so many places."""
    pools = []

    def connect(cluster: Cluster | Network, *, places: int = 1, silent_seconds: float = 3600.0) -> DaskPool:
        terms = {"memory_mb": LIMITS.memory_mb, "silent_seconds": silent_seconds}
        pools.append(DaskPool(cluster.address, TASKS.name, **terms))
        wait_until(lambda: pools[-1].places() >= places)
        return pools[-1]

    yield connect
    for pool in pools:
        pool.close()


@pytest.fixture(params=["local", pytest.param("dask", marks=pytest.mark.long)])
def pool(request):
    """A pool with one place."""
    if request.param == "local":
        return ChildrenPool(request.getfixturevalue("sandbox"), CHORES, slots=1)
    return request.getfixturevalue("connected")(request.getfixturevalue("cluster"))
