"""Runs the service for ``polhode serve``: the database, the API and the worker process beside it."""

import socket

from service.cli.common import REFUSED, fail, migrate_database
from service.cli.database import require_key
from service.local.wakeup import WakeUpSocket
from service.local.workers import LocalWorkers
from service.logs import start_logging
from service.sandbox import lack_of_room
from service.settings import Settings
from service.verdicts.starting import VerdictChildren, verdict_children

_TASKS, _TASKS_OF_A_CHILD = 50, 2
"""Threads of the API when all are busy, and the processes around its children, counted."""
_ADDRESS_MB = 2000
"""Libraries and stacks of all threads take 1600; hardly a tenth of it is memory."""


def run_service(settings: Settings) -> None:
    """Serve until SIGTERM or SIGINT.

    The worker process is started first, then the children for verdicts. While they load the mathematics, this
    process migrates the database and loads the web framework; the worker uses the database only when it is
    told that it is ready.
    """
    start_logging(settings.log_format, settings.log_level or "warning")
    tasks = _TASKS + _TASKS_OF_A_CHILD * (verdict_children() + settings.workers)
    if (reason := lack_of_room(tasks=tasks, megabytes=_ADDRESS_MB)) is not None:
        fail(reason, REFUSED)
    if not settings.is_loopback:
        require_key(settings)
    with _listen(settings.host, settings.port) as listener:
        wake_up = WakeUpSocket(is_database_ready=False)
        workers = LocalWorkers(settings, wake_up) if settings.workers else None
        verdicts = VerdictChildren(settings)
        try:
            migrate_database(settings)
            # Not at the top: it loads the web framework.
            from service.cli.http_server import serve_http  # noqa: PLC0415
        except BaseException:
            if workers is not None:
                workers.forgo()
            verdicts.close()
            wake_up.close()
            raise
        serve_http(settings, listener, wake_up, workers, verdicts)


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as fault:
        fail(f"cannot listen on {host} port {port}: {fault.strerror or fault}", REFUSED)
