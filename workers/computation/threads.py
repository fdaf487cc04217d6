"""Limits the threads of the numerical libraries, before these are loaded."""

import os


def use_one_thread() -> None:
    """Have numerical libraries use one thread, unless the environment says otherwise.

    Slots share the cores already, the stacks of idle threads would count as a job's memory, and the last
    digits of a product of matrices may depend on how it is divided.
    """
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
