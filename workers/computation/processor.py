"""Records the processor and library versions; where they are equal, equal problems give equal bits.

Sums, sines and matrix products of doubles are computed by other instructions on
other processors, hence rounded otherwise in their last bits. Which, the
libraries choose by the features of a processor, not by its model.
"""

import ctypes
import os
import platform
from functools import cache
from pathlib import Path

import numpy as np

from service.versions import version_of

LIBRARIES = ("numpy", "scipy", "numba", "python-flint")
HIDING = ("NPY_DISABLE_CPU_FEATURES", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "GLIBC_TUNABLES")
"""Environment variables that hide features of the processor from a library."""


@cache
def processor() -> str:
    """Return the architecture, the features that numpy dispatches on, and the kernels of its matrix products.

    What hides features from a library is told as it was set: the mathematical
    library of the platform and the compiler do not say what they found.
    """
    # NPY_DISABLE_CPU_FEATURES is seen in what is found.
    hidden = [f"{name}={os.environ[name]}" for name in HIDING[1:] if os.environ.get(name)]
    features = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    kernels = _matrix_kernels()
    return " ".join([platform.machine(), *features, *([f"BLAS:{kernels}"] if kernels else []), *hidden])


@cache
def libraries() -> str:
    """Return the versions of what computes with doubles, Python and the platform's own library among it."""
    libc = " ".join(platform.libc_ver()) if platform.system() == "Linux" else platform.platform()
    named = [
        f"Python {platform.python_version()}",
        *(f"{name} {version_of(name)}" for name in LIBRARIES),
    ]
    return ", ".join([*named, libc])


def threads() -> int | None:
    """Return among how many threads a product of matrices may be divided; None if the library does not tell.

    All else is computed by one thread: kernels are compiled without parallel loops, and a job is one child.
    """
    library = _openblas()
    return None if library is None else int(library.scipy_openblas_get_num_threads64_())


def _matrix_kernels() -> str | None:
    """Return for which processor the OpenBLAS in numpy's wheel has chosen its kernels; None without it."""
    library = _openblas()
    if library is None:
        return None
    name = library.scipy_openblas_get_corename64_
    name.restype = ctypes.c_char_p
    found = name()
    return found.decode("ascii") if isinstance(found, bytes) else None


@cache
def _openblas() -> ctypes.CDLL | None:
    """Return the OpenBLAS in numpy's wheel, if it is there and has the functions that are asked here."""
    folder = Path(np.__file__).parents[1] / "numpy.libs"
    for file in sorted(folder.glob("libscipy_openblas*")):
        try:
            library = ctypes.CDLL(str(file))
        except OSError:
            continue
        if all(hasattr(library, f"scipy_openblas_get_{each}64_") for each in ("corename", "num_threads")):
            return library
    return None
