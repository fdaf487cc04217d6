"""Ids are UUIDs of version 7 that grow."""

import time
import uuid
from concurrent.futures import ThreadPoolExecutor

from service.storage.database.rows import IdSource, is_id


def test_ids_grow_and_differ_in_every_thread():
    source = IdSource()
    with ThreadPoolExecutor(4) as pool:
        runs = list(pool.map(lambda _: [source() for _ in range(1000)], range(4)))
    assert all(run == sorted(run) for run in runs)
    assert len({identifier for run in runs for identifier in run}) == 4000


def test_an_id_is_a_version_7_uuid_of_this_moment():
    before = time.time_ns()
    identifier = uuid.UUID(IdSource()())
    after = time.time_ns()
    assert (identifier.version, identifier.variant) == (7, uuid.RFC_4122)
    assert before // 10**6 <= identifier.int >> 80 <= after // 10**6


def test_only_ids_are_ids():
    assert is_id(IdSource()())
    assert not any(map(is_id, ["", "1", "../etc/passwd", "{" + IdSource()() + "}"]))
