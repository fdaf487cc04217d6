"""``python -m tests.support.other_processor COMMAND``: run a command as on a processor with fewer features.

Every library that chooses its instructions by the processor is told to choose
as on the oldest processor that it runs on: numpy, its matrix products, the
compiler, and the mathematical library of the platform. The integrator heyoka
asks the processor itself and cannot be told.
"""

import os
import sys
from collections.abc import Mapping

import numpy as np

FEATURES = ("AVX2", "FMA", "FMA4", "AVX512F", "AVX2_Usable", "FMA_Usable", "FMA4_Usable")
"""Features by which the mathematical library of GNU chooses; the last are their names in old versions."""


def masks() -> Mapping[str, str]:
    """Return the environment variables that hide what this processor has beyond the oldest one."""
    # numpy refuses names that it does not know, and warns of features that are not there.
    found = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    return {
        "NPY_DISABLE_CPU_FEATURES": ",".join(found),
        "OPENBLAS_CORETYPE": "Nehalem",
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=" + ",".join(f"-{name}" for name in FEATURES),
    }


def environment() -> dict[str, str]:
    """Return the environment of a process that is to run so."""
    return {**os.environ, **masks()}


def main() -> None:
    program, *arguments = sys.argv[1:]
    os.execvpe(program, [program, *arguments], environment())


if __name__ == "__main__":
    main()
