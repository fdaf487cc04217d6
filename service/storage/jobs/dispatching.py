"""Chooses the dispatcher by the setting POLHODE_ENGINE."""

from sqlalchemy import Connection

from service.jobs.store import Dispatcher
from service.settings import Settings
from service.storage.jobs.table_dispatcher import TableDispatcher


def dispatcher_of(settings: Settings) -> Dispatcher[Connection]:
    """Return the dispatcher of the chosen engine."""
    if settings.engine != "procrastinate":
        return TableDispatcher()
    # Most installations never load it.
    from service.storage.jobs.procrastinate_dispatcher import ProcrastinateDispatcher  # noqa: PLC0415

    return ProcrastinateDispatcher()
