"""A service says that another one uses its database, where there should be one only."""

import os
import signal
import subprocess
import sys

import pytest
from sqlalchemy import insert

from service.local.workers import new_worker_name
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.operations import WorkerRow
from service.storage.upkeep.presence import GONE_SECONDS, SERVICE, ServicePresence
from tests.support.serving import serving
from tests.support.waiting import wait_until

HERE = "this machine"


@pytest.fixture
def living():
    """The number of a process that lives as long as the test."""
    process = subprocess.Popen([sys.executable, "-c", "import sys; sys.stdin.read()"], stdin=subprocess.PIPE)
    yield process.pid
    process.communicate()


@pytest.fixture
def ended():
    """The number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def put(database, host, process, *, ago=1.0, engine=SERVICE):
    name = new_worker_name(host).replace(f":{os.getpid()}:", f":{process}:")
    row = {"name": name, "host": host, "engine": engine, "slots": 0 if engine == SERVICE else 1}
    seen = {"started_at": DatabaseNow() - ago, "seen_at": DatabaseNow() - ago}
    with database.write_rows() as connection:
        connection.execute(insert(table_of(WorkerRow)).values(**row, **seen))


def warnings(database, caplog, **options) -> list[str]:
    presence = ServicePresence(database, host=HERE, **options)
    presence.start()
    wait_until(lambda: presence._began_at is None and presence._fault is None and is_there(database))
    presence.close()
    return [record.getMessage() for record in caplog.records if "another service" in record.getMessage()]


def is_there(database) -> bool:
    with database.read_rows() as connection:
        names = connection.execute(table_of(WorkerRow).select()).scalars().all()
    return any(f":{os.getpid()}:" in name for name in names)


@pytest.mark.any_database
def test_another_service_is_told_with_its_process_and_its_machine(database, caplog, living):
    put(database, HERE, living)
    put(database, "host:with:colons", 7)
    told = warnings(database, caplog, is_only=True)
    assert {line.partition(" (seen")[0] for line in told} == {
        "another service uses this database: process 7 of host:with:colons",
        f"another service uses this database: process {living} of {HERE}",
    }


@pytest.mark.any_database
def test_workers_and_the_dead_are_no_services(database, caplog, living, ended):
    put(database, HERE, living, engine="local")
    put(database, HERE, ended)
    put(database, HERE, living, ago=GONE_SECONDS + 5.0)
    assert warnings(database, caplog, is_only=True) == []


def test_several_services_are_as_they_should_be_with_the_engine_of_several_machines(database, caplog, living):
    put(database, HERE, living)
    assert warnings(database, caplog) == []


@pytest.mark.long
def test_a_second_serve_on_one_file_says_so_and_one_after_a_kill_does_not(tmp_path):
    def said_by(name: str, *, until: str = "") -> str:
        with (tmp_path / name).open("wb") as log, serving(tmp_path, workers=0, stderr=log):
            wait_until(lambda: until in (tmp_path / name).read_text(encoding="utf-8"))
        return (tmp_path / name).read_text(encoding="utf-8")

    with serving(tmp_path, workers=0) as first:
        assert f"process {first.process.pid} of " in said_by("second", until="another service")
        first.process.send_signal(signal.SIGKILL)
        first.process.wait()
        assert "another service" not in said_by("third")
