"""Compiles functions by numba, and keeps their machine code in the folder that was passed in."""

from collections.abc import Callable
from typing import Any, TypeVar, cast  # Any: numba has no types

import numba

from workers.solvers.compiled import code_folder

F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile ``function`` at its first call; division by zero gives inf or NaN, sums keep their order."""
    compiled: Any = numba.njit(error_model="numpy", nogil=True)(function)

    def keep(folder: str) -> None:
        numba.config.CACHE_DIR = folder  # type: ignore[attr-defined]
        compiled.enable_caching()

    code_folder.when_named(keep)
    return cast("F", compiled)


def inlined(function: F) -> F:
    """Put ``function`` into the kernels that call it, which loops over several numbers at once need."""
    compiler = numba.njit(inline="always", error_model="numpy", nogil=True)
    return cast("F", compiler(function))
