"""The Python client of polhode: ``import polhode as ph``; ``ph.connect()`` is where everything begins."""

from polhode.clients import AsyncClient, Client
from polhode.connecting import connect, connect_async
from polhode.documents.problems import problem
from polhode.documents.quantities import Quantity
from polhode.documents.spans import linspace, logspace, uniform
from polhode.errors import (
    FailedError,
    MissingError,
    PolhodeError,
    RefusedError,
    UnfinishedError,
    UnreachableError,
    WrongArgumentError,
)
from polhode.evaluation.samples import Samples
from polhode.jobs import SomeFailedError
from polhode.local import local

__all__ = [
    "AsyncClient",
    "Client",
    "FailedError",
    "MissingError",
    "PolhodeError",
    "Quantity",
    "RefusedError",
    "Samples",
    "SomeFailedError",
    "UnfinishedError",
    "UnreachableError",
    "WrongArgumentError",
    "connect",
    "connect_async",
    "linspace",
    "local",
    "logspace",
    "problem",
    "uniform",
]
