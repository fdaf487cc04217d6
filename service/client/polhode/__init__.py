"""The Python client of polhode: ``import polhode as ph``; ``ph.connect()`` is where everything begins."""

from polhode.clients import AsyncClient, Client
from polhode.connecting import connect, connect_async, local
from polhode.documents.problems import problem
from polhode.documents.quantities import Quantity, linspace, logspace, uniform
from polhode.errors import (
    FailedError,
    MissingError,
    PolhodeError,
    RefusedError,
    SomeFailedError,
    UnfinishedError,
    UnreachableError,
    WrongArgumentError,
)
from polhode.evaluation import Samples

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
