"""Makes clients of a service that runs somewhere."""

import os
from collections.abc import Callable
from pathlib import Path

from polhode.clients import AsyncClient, Client
from polhode.errors import WrongArgumentError
from polhode.showing.progress import Bar, is_watched
from polhode.transport.cache import Cache, default_folder
from polhode.transport.carriers import LoopCarrier, ThreadCarrier
from polhode.transport.terms import DEFAULT_URL, Progress, Terms


def connect(
    url: str | None = None,
    key: str | None = None,
    *,
    patience: float = 120.0,
    cache: bool | str | os.PathLike[str] = True,
    progress: bool | Callable[[Progress], None] | None = None,
) -> Client:
    """Return a client of the service at ``url``; nothing is sent before something is asked.

    Parameters
    ----------
    url
        POLHODE_URL if left out, else http://127.0.0.1:8000.
    key
        The API key; POLHODE_KEY if left out, else none.
    patience
        Seconds for which requests without an answer are sent again; what makes something is made once.
    cache
        Keep on disk what never changes: in POLHODE_CACHE or a folder of this user, or in the folder given.
    progress
        Draw a bar, or what to tell the progress; None: a bar on terminals and in notebooks.
    """
    return Client(ThreadCarrier(terms_of(url, key, patience, cache=cache, progress=progress)))


def connect_async(
    url: str | None = None,
    key: str | None = None,
    *,
    patience: float = 120.0,
    cache: bool | str | os.PathLike[str] = True,
    progress: bool | Callable[[Progress], None] | None = None,
) -> AsyncClient:
    """Return a client whose operations are awaited; the arguments are those of :func:`connect`."""
    return AsyncClient(LoopCarrier(terms_of(url, key, patience, cache=cache, progress=progress)))


def terms_of(
    url: str | None,
    key: str | None = None,
    patience: float = 120.0,
    *,
    cache: bool | str | os.PathLike[str] = True,
    progress: bool | Callable[[Progress], None] | None = None,
) -> Terms:
    """Return on which terms a client asks; the arguments are those of :func:`connect`."""
    address = (url or os.environ.get("POLHODE_URL") or DEFAULT_URL).rstrip("/")
    if not address.startswith(("http://", "https://")):
        raise WrongArgumentError(f"{address!r} is no address; such as {DEFAULT_URL} is accepted")
    folder = default_folder() if isinstance(cache, bool) else Path(cache)
    if progress is None:
        progress = is_watched()
    told = Bar() if progress is True else progress or None
    kept = None if cache is False else Cache(folder)
    return Terms(address, key or os.environ.get("POLHODE_KEY"), patience, kept, told)
