"""Chooses the dispatcher by the setting POLHODE_ENGINE."""

from sqlalchemy import Connection

from service.jobs.dispatch import Dispatcher
from service.settings import Settings
from service.storage.jobs.procrastinate_dispatcher import ProcrastinateDispatcher
from service.storage.jobs.table_dispatcher import TableDispatcher


def dispatcher_of(settings: Settings) -> Dispatcher[Connection]:
    """Return the dispatcher of the chosen engine."""
    return ProcrastinateDispatcher() if settings.engine == "procrastinate" else TableDispatcher()
