"""Connections are limited, in number and in time, and the log stays short."""

import asyncio
import json
import logging
import socket
import subprocess
import sys
import threading
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path

import anyio
import pytest
import uvicorn
from fastapi import FastAPI

from service.app import create_app
from service.connections.gate import UNREAD_SECONDS, Gate, Phase
from service.connections.server import Listener, guarded
from service.logs import Complaints, place_of
from service.settings import Settings
from tests.support.keys import Clock

SLOW = 3600.0
"""A deadline that does not pass while a test runs."""
OPENED = []
"""What the clients of a test have opened."""


class Connection:
    def __init__(self):
        self.is_open, self.is_sending = True, False

    def give_up(self):
        self.is_open = False


def entered(gate, *phases):
    connections = [Connection() for _ in phases]
    for connection, phase in zip(connections, phases, strict=True):
        gate.enter(connection)
        gate.move(connection, phase)
    return connections


def make_gate(capacity, **further):
    return Gate(capacity, Complaints(logging.getLogger("test")), **further)


def test_idle_connections_are_closed_first_then_unfinished_requests_and_never_those_at_work():
    gate = make_gate(5)
    phases = (Phase.ANSWER, Phase.BODY, Phase.HEAD, Phase.IDLE, Phase.IDLE)
    at_work, body, head, idle_longest, idle = entered(gate, *phases)
    order = []
    while gate.give_one_up():
        order.append(sum(not c.is_open for c in (body, head, idle_longest, idle)))
    assert order == [1, 2, 3, 4]
    assert at_work.is_open
    assert len(gate) == 1


def test_the_one_idle_for_longest_goes_first():
    gate = make_gate(2)
    first, second = entered(gate, Phase.IDLE, Phase.IDLE)
    gate.move(first, Phase.ANSWER)
    gate.move(first, Phase.IDLE)
    assert gate.make_room()
    assert (first.is_open, second.is_open) == (True, False)
    assert gate.make_room()
    assert first.is_open


def test_an_answer_that_still_flows_is_not_cut_off_to_make_room():
    gate = make_gate(2)
    flowing, idle = entered(gate, Phase.IDLE, Phase.IDLE)
    flowing.is_sending = True
    assert gate.make_room()
    assert (flowing.is_open, idle.is_open) == (True, False)
    entered(gate, Phase.ANSWER)
    assert not gate.make_room()
    flowing.is_sending = False
    assert gate.make_room()
    assert not flowing.is_open


def test_a_client_that_does_not_read_its_answer_makes_room_after_a_while():
    clock = Clock()
    gate = make_gate(3, clock=clock)
    first, second, reading = entered(gate, Phase.ANSWER, Phase.ANSWER, Phase.ANSWER)
    gate.stop_flowing(first)
    clock.now += 1
    gate.stop_flowing(second)
    gate.stop_flowing(reading)
    gate.flow(reading)
    clock.now += UNREAD_SECONDS - 1.5
    assert not gate.make_room()
    clock.now += 1
    gate.stop_flowing(first)  # it has not read since the first time
    assert gate.make_room()
    assert (first.is_open, second.is_open) == (False, True)
    assert len(gate) == 2
    clock.now += 1
    assert gate.close_one_unread()
    assert not gate.close_one_unread()
    assert (second.is_open, reading.is_open) == (False, True)


def test_there_is_no_room_when_all_are_at_work():
    gate = make_gate(1)
    entered(gate, Phase.ANSWER)
    assert not gate.make_room()


def test_a_complaint_is_written_once_in_a_while_with_the_number_of_the_others(caplog):
    clock = Clock()
    complaints = Complaints(logging.getLogger("test"), clock)
    for _ in range(1000):
        complaints.tell("too many")
    clock.now += 11
    complaints.tell("too many")
    assert [record.getMessage() for record in caplog.records] == [
        "too many",
        "too many (999 times more since the last line)",
    ]


def test_complaints_of_one_kind_are_one_whatever_they_say_and_faults_of_one_line_are_of_one_kind(caplog):
    complaints, faults = Complaints(logging.getLogger("test"), Clock()), []
    for number in range(3):
        try:
            {}[number]
        except KeyError as fault:
            faults.append(fault)
            complaints.tell(f"request {number}", fault, kind=place_of(fault), level=logging.ERROR)
    complaints.tell("request 3", kind="another")
    assert [(record.getMessage(), record.levelname) for record in caplog.records] == [
        ("request 0", "ERROR"),
        ("request 3", "WARNING"),
    ]
    assert caplog.records[0].exc_info[1] is faults[0]
    assert place_of(KeyError()) == "KeyError"


@contextmanager
def listening(gate):
    opened = socket.create_server(("127.0.0.1", 0))
    with Listener(gate, fileno=opened.detach()) as listener:
        listener.setblocking(False)
        yield listener


def test_answers_do_not_wait_for_acknowledgements():
    with listening(make_gate(5)) as listener, socket.create_connection(listener.getsockname()):
        accepted, _ = listener.accept()
        with accepted:
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_without_descriptors_a_client_is_told_so_and_accepting_pauses_if_even_that_fails(monkeypatch, caplog):
    gate = make_gate(5)
    with listening(gate) as listener:
        with socket.create_connection(listener.getsockname()) as client:
            right = socket.socket.accept
            faults = [OSError(24, "Too many open files")]
            monkeypatch.setattr(socket.socket, "accept", lambda self: raise_or(faults, lambda: right(self)))
            with pytest.raises(BlockingIOError):
                listener.accept()
            assert client.recv(1000).startswith(b"HTTP/1.1 503 ")
        (idle,) = entered(gate, Phase.IDLE)
        faults.append(OSError(24, "Too many open files"))
        with pytest.raises(BlockingIOError):
            listener.accept()
        assert not idle.is_open
        monkeypatch.setattr(listener, "_drop_spare", lambda: setattr(listener, "_spare", None))
        monkeypatch.setattr(listener, "_keep_spare", lambda: None)
        faults += [OSError(24, "Too many open files")] * 10
        with pytest.raises(BlockingIOError):
            listener.accept()  # with the spare, which does not come back
        with pytest.raises(OSError, match="Too many open files"):
            listener.accept()
        left = len(faults)
        with pytest.raises(BlockingIOError):
            listener.accept()
        assert len(faults) == left, "it pauses, and does not ask again"
    assert len(caplog.records) == 1


def raise_or(faults, act):
    if faults:
        raise faults.pop()
    return act()


@asynccontextmanager
async def serving(app: FastAPI, **settings):
    """Run a server in this process; yield its port."""
    opened = socket.create_server(("127.0.0.1", 0))
    port = opened.getsockname()[1]
    config, listener = guarded(app, Settings(**settings), opened)
    server = uvicorn.Server(config)
    running = asyncio.create_task(server.serve(sockets=[listener]))
    with anyio.fail_after(60):
        while not server.started:
            await asyncio.sleep(0.01)
    try:
        yield port
    finally:
        server.should_exit = True
        await running


def serve(act, app=None, **settings):
    """Let ``act`` talk to a server that runs on the same event loop."""

    async def serve_and_act():
        async with serving(app or simple_app(), **settings) as port:
            with anyio.fail_after(120):
                try:
                    await act(port)
                finally:
                    for writer in OPENED:
                        writer.close()
                        writer.transport.abort()
                    for writer in OPENED:
                        with suppress(ConnectionError):
                            await writer.wait_closed()
                    OPENED.clear()

    # Not on the main thread: uvicorn would take the signals.
    failures = []

    def run():
        try:
            asyncio.run(serve_and_act())
        except BaseException as failure:
            failures.append(failure)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    if failures:
        raise failures[0]


def simple_app():
    app = FastAPI()
    app.state.free = asyncio.Event()

    @app.get("/livez")
    async def livez():
        return "alive"

    @app.get("/blocked")
    async def blocked():
        await app.state.free.wait()
        return "free"

    @app.get("/large")
    async def large():
        return "x" * 50_000_000

    return app


async def connect(port):
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    OPENED.append(writer)
    return reader, writer


async def exchange(port, content, *, until_closed=True):
    reader, writer = await connect(port)
    writer.write(content)
    answer = await reader.read() if until_closed else await reader.readuntil(b"\r\n\r\n")
    return reader, writer, answer


def problem(answer):
    head, _, content = answer.partition(b"\r\n\r\n")
    document = json.loads(content)
    assert b"application/problem+json" in head
    assert head.startswith(f"HTTP/1.1 {document['status']} ".encode())
    lines = head.lower().split(b"\r\n")
    assert f"x-request-id: {document['request_id']}".encode() in lines
    assert any(line.startswith(b"server: polhode/") for line in lines)
    return document["status"], document["type"].removeprefix("urn:polhode:problem:")


GET = b"GET /livez HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
ONCE = b"GET /livez HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"


@pytest.mark.parametrize("sent", [b"G", b"GET /livez HTTP/1.1\r\nHost: 1", GET + b"GET /liv"])
def test_a_head_has_a_deadline(sent):
    async def act(port):
        _, _, answer = await exchange(port, sent)
        if sent.startswith(GET):
            assert answer.startswith(b"HTTP/1.1 200 ")
            answer = answer[answer.index(b"HTTP/1.1 408") :]
        assert problem(answer) == (408, "request_timeout")

    serve(act, header_seconds=0.2)


def test_a_connection_without_any_request_is_closed_without_a_word():
    async def act(port):
        _, _, answer = await exchange(port, b"")
        assert answer == b""

    serve(act, header_seconds=0.2)


def test_a_connection_that_is_kept_is_closed_when_it_has_been_idle():
    async def act(port):
        _, _, answer = await exchange(port, GET)
        assert answer.startswith(b"HTTP/1.1 200 ")

    serve(act, header_seconds=SLOW, idle_seconds=1)


def test_a_body_that_nobody_reads_has_a_deadline():
    async def act(port):
        reader, writer, _ = await exchange(
            port, GET.replace(b"\r\n\r\n", b"\r\nContent-Length: 1000000\r\n\r\nabc"), until_closed=False
        )

        async def dribble():
            while True:
                writer.write(b"x")
                await asyncio.sleep(0.05)

        dribbling = asyncio.create_task(dribble())
        with suppress(ConnectionError):
            while await reader.read(1000):
                pass
        dribbling.cancel()

    serve(act, body_seconds=0.3, header_seconds=SLOW, idle_seconds=3600)


def test_a_client_that_does_not_read_its_answer_loses_the_connection():
    async def act(port):
        _, writer, _ = await exchange(port, GET.replace(b"livez", b"large"), until_closed=False)
        # Nothing more is read: what the buffers do not hold is never sent.
        with suppress(ConnectionError):
            while not writer.is_closing():
                writer.write(b"x")
                await asyncio.sleep(0.05)
                await writer.drain()

    serve(act, send_seconds=0.3)


def test_beyond_the_limit_idle_and_unfinished_requests_make_room():
    async def act(port):
        opened = [await connect(port) for _ in range(40)]
        for _, writer in opened[::2]:
            writer.write(b"GET /liv")
        for _ in range(5):
            _, _, answer = await exchange(port, ONCE)
            assert answer.startswith(b"HTTP/1.1 200 ")

    serve(act, max_connections=10, header_seconds=SLOW)


def test_beyond_the_limit_those_at_work_stay_and_a_new_one_is_told():
    async def act(port):
        blocked = [asyncio.create_task(exchange(port, ONCE.replace(b"livez", b"blocked"))) for _ in range(3)]
        with anyio.fail_after(60):
            while True:
                _, _, answer = await exchange(port, b"")
                if answer:
                    break
        assert problem(answer) == (503, "too_many_connections")
        assert b"Retry-After: " in answer
        app.state.free.set()
        for _, _, answered in await asyncio.gather(*blocked):
            assert answered.startswith(b"HTTP/1.1 200 ")
        _, _, answer = await exchange(port, ONCE)
        assert answer.startswith(b"HTTP/1.1 200 ")

    app = simple_app()
    serve(act, app, max_connections=3, header_seconds=0.1)


@pytest.mark.parametrize(
    ("sent", "status"),
    [
        (b"\x16\x03\x01 hello\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\nHost: a\r\nA: " + b"x" * 100_000, 431),
        (b"POST / HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: gzip\r\n\r\n", 501),
        (b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\nx", 400),
    ],
)
def test_what_is_no_request_is_answered_by_a_problem_document(sent, status):
    async def act(port):
        _, _, answer = await exchange(port, sent)
        assert problem(answer) == (status, "invalid_http")

    serve(act)


def test_a_body_has_a_deadline(sqlite_url, verdicts):
    async def act(port):
        head = b"POST /v1/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
        _, _, answer = await exchange(port, head + b"Content-Length: 100\r\n\r\n{")
        assert problem(answer) == (408, "request_timeout")

    settings = {"database_url": sqlite_url, "body_seconds": 0.2}
    serve(act, create_app(Settings(**settings), sandbox=verdicts), **settings)


def test_whoever_sends_too_much_is_told_so_and_may_go_on(sqlite_url, verdicts):
    async def act(port):
        head = b"POST /v1/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
        reader, writer = await connect(port)
        # All of it is sent before anything is read, as a proxy does; the kernel does not buffer so much.
        writer.write(head + b"Content-Length: 15000000\r\n\r\n" + b" " * 15_000_000)
        await writer.drain()
        assert (await reader.readline()).startswith(b"HTTP/1.1 413 ")
        writer.write(ONCE)
        assert (await reader.read()).count(b"HTTP/1.1 200 ") == 1
        writer.close()

    settings = {"database_url": sqlite_url}
    serve(act, create_app(Settings(**settings), sandbox=verdicts), **settings)


def test_a_request_of_two_lengths_is_refused_and_nothing_after_it_is_read(sqlite_url, verdicts):
    async def act(port):
        head = b"POST /v1/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
        both = head + b"Content-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
        _, _, answer = await exchange(port, both + GET)
        assert answer.count(b"HTTP/1.1 ") == 1
        assert problem(answer) == (400, "ambiguous_length")

    settings = {"database_url": sqlite_url}
    serve(act, create_app(Settings(**settings), sandbox=verdicts), **settings)


def test_a_request_whose_client_hangs_up_while_sending_is_no_fault_of_ours(sqlite_url, verdicts, caplog):
    async def act(port):
        head = b"POST /v1/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
        _, writer = await connect(port)
        writer.write(head + b"Content-Length: 100\r\n\r\n{")
        await asyncio.sleep(0.1)
        writer.close()
        with anyio.fail_after(60):
            while 'status="499"' not in app.state.resources.metrics.text().decode():
                await asyncio.sleep(0.01)

    settings = {"database_url": sqlite_url}
    app = create_app(Settings(**settings), sandbox=verdicts)
    caplog.set_level(logging.INFO)
    serve(act, app, **settings)
    records = [record for record in caplog.records if record.levelno > logging.INFO]
    assert [record.getMessage() for record in records] == []


SERVER = """
import resource, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
sys.argv = ["polhode", "serve", "--port", "0", "--workers", "0"]
from service.cli.main import main
main()
"""


@pytest.mark.long
def test_a_service_with_few_descriptors_answers_although_many_connections_are_idle(tmp_path):
    """64 descriptors and 80 connections: a new one is always answered, and the log does not grow."""
    root = Path(__file__).parents[2]
    process = subprocess.Popen(
        [sys.executable, "-c", SERVER],
        cwd=tmp_path,
        env={"PYTHONPATH": str(root), "PATH": "/usr/bin:/bin", "POLHODE_HEADER_SECONDS": "3600"},
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        line = process.stderr.readline()
        port = int(line.partition("http://127.0.0.1:")[2].partition(",")[0])
        idle = [socket.create_connection(("127.0.0.1", port)) for _ in range(80)]
        for _ in range(10):
            with socket.create_connection(("127.0.0.1", port), timeout=60) as client:
                client.sendall(ONCE)
                assert client.makefile("rb").readline().startswith(b"HTTP/1.1 200 ")
        for connection in idle:
            connection.close()
    finally:
        process.terminate()
        _, rest = process.communicate(timeout=60)
    assert len(rest.splitlines()) < 20, rest
