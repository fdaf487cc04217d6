"""Apart, since it loads the web framework: serves the API over HTTP on an open socket, until a signal."""

import socket
import sys

import typer
import uvicorn

from service.app import create_app
from service.cli.common import REFUSED
from service.connections.server import guarded
from service.local.wakeup import WakeUpSocket
from service.local.workers import LocalWorkers
from service.logs import announce
from service.settings import Settings
from service.startup import StopAsked, keep_what_is_loaded
from service.verdicts.starting import VerdictChildren

_SWITCH_SECONDS = 0.001
"""A thread keeps the interpreter for so long while others want it; Python's own is five times as long."""


def serve_http(
    settings: Settings,
    listener: socket.socket,
    wake_up: WakeUpSocket,
    workers: LocalWorkers | None,
    verdicts: VerdictChildren,
) -> None:
    """Serve on a migrated database; at the end stop all children, which no second signal interrupts."""

    class _Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            # Uvicorn handles signals by now; this flag holds those that came before.
            self.should_exit |= stop.is_asked
            await super().startup(sockets)

        async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
            if workers is not None:
                workers.expect_end()
            # Workers finish and stop; clients that wait for a job get its present state.
            wake_up.close()
            await super().shutdown(sockets)

    # From here on the end needs a clean-up.
    with StopAsked() as stop:
        wake_up.when_warm(lambda: announce("the workers are warm"))
        try:
            standing = None if workers is None else workers.standing
            app = create_app(
                settings, wake_up_socket=wake_up, sandbox=verdicts.ready(), local_worker=standing
            )
            config, listener = guarded(app, settings, listener)
            server = _Server(config)
            host, port = listener.getsockname()[:2]
            announce(
                f"serving http://{f'[{host}]' if ':' in host else host}:{port}, {settings.workers} workers"
            )
            keep_what_is_loaded()
            # Not earlier: what workers say comes after that line.
            wake_up.tell_database_is_ready()
            # Threads that write text take the interpreter from the event loop: this is how long it waits for
            # each of them.
            sys.setswitchinterval(_SWITCH_SECONDS)
            # Uvicorn raises the signals it received again at its end: they have been handled already.
            server.run(sockets=[listener])
            if not server.started:
                raise typer.Exit(REFUSED)
        finally:
            if workers is not None:
                # Not earlier: of two signals the first one stops the server.
                workers.stop(urged=stop.urge)
            verdicts.close()
            wake_up.close()
