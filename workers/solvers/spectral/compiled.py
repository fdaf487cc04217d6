"""Compilation of kernels, kept across processes in a folder of our own.

A kernel contains the kernels it calls, so compiled code is good for one state of
all the sources of this package: the folder is named by their digest.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])

FOLDER_VARIABLE = "NUMBA_CACHE_DIR"
"""Names another folder; it must belong to us, since what is in it is run."""


def _own_folder() -> Path | None:
    """Return the folder of the compiled code, None if there is none that only we can write to."""
    cache = os.environ.get("XDG_CACHE_HOME")
    base = os.environ.get(FOLDER_VARIABLE)
    try:
        home = Path(cache) if cache else Path.home() / ".cache"
        folder = (Path(base) if base else home / "polhode") / f"compiled-{_digest()}"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = folder.stat()
    except (OSError, RuntimeError):  # no home, or no room in it
        return None
    is_ours = about.st_uid == os.getuid() and not about.st_mode & 0o022
    return folder if is_ours and os.access(folder, os.W_OK) else None


def _digest() -> str:
    """Return a digest of the sources of this package and of the compiler's version."""
    total = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        total.update(source.read_bytes())
    return total.hexdigest()[:16]


_FOLDER = _own_folder()
if _FOLDER is not None:
    numba.config.CACHE_DIR = str(_FOLDER)  # type: ignore[attr-defined]


def kernel(function: F) -> F:
    """Compile ``function`` at its first call; division by zero gives inf or NaN, sums keep their order."""
    compiler = numba.njit(cache=_FOLDER is not None, error_model="numpy", nogil=True)
    return cast("F", compiler(function))
