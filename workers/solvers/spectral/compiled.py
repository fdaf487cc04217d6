"""Compilation of kernels, kept across processes in a folder of our own.

A kernel contains the kernels it calls, so compiled code is good for one state of
all the sources of this package: the folder is named by their digest.
"""

import hashlib
import os
from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])

FOLDER_VARIABLE = "NUMBA_CACHE_DIR"
"""Names another folder; it must belong to us, since what is in it is run."""


def _own_folder() -> str | None:
    """Return the folder of the compiled code, None if there is none that only we can write to."""
    base = os.environ.get(FOLDER_VARIABLE) or os.path.join(  # noqa: PTH118
        os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache"),  # noqa: PTH111, PTH118
        "polhode",
    )
    folder = os.path.join(base, f"compiled-{_digest()}")  # noqa: PTH118
    try:
        os.makedirs(folder, mode=0o700, exist_ok=True)  # noqa: PTH103
        about = os.stat(folder)  # noqa: PTH116
    except OSError:
        return None
    is_ours = about.st_uid == os.getuid() and not about.st_mode & 0o022
    return folder if is_ours and os.access(folder, os.W_OK) else None


def _digest() -> str:
    """Return a digest of the sources of this package and of the compiler's version."""
    here = os.path.dirname(__file__)  # noqa: PTH120
    total = hashlib.sha256(numba.__version__.encode())
    for name in sorted(os.listdir(here)):  # noqa: PTH208
        if name.endswith(".py"):
            with open(os.path.join(here, name), "rb") as source:  # noqa: PTH118, PTH123
                total.update(source.read())
    return total.hexdigest()[:16]


_FOLDER = _own_folder()
if _FOLDER is not None:
    numba.config.CACHE_DIR = _FOLDER  # type: ignore[attr-defined]


def kernel(function: F) -> F:
    """Compile ``function`` at its first call; division by zero gives inf or NaN, sums keep their order."""
    compiler = numba.njit(cache=_FOLDER is not None, error_model="numpy", nogil=True)
    return cast("F", compiler(function))


def inlined(function: F) -> F:
    """Put ``function`` into the kernels that call it, which loops over several numbers at once need."""
    compiler = numba.njit(inline="always", error_model="numpy", nogil=True)
    return cast("F", compiler(function))
