"""Versions of installed distributions, each read once for a process."""

from functools import cache


@cache
def version_of(distribution: str) -> str:
    """Return the version of an installed distribution, such as ``polhode`` or ``numpy``.

    Reading it opens files and parses them, a millisecond and more each time; it cannot change while a
    process runs.

    Raises
    ------
    importlib.metadata.PackageNotFoundError
        It is not installed. This is an ``ImportError``.
    """
    # Here and not at the top: it loads the parser of e-mail, which most commands never need.
    from importlib.metadata import version  # noqa: PLC0415, TID251

    return version(distribution)
