"""The first steps of every process: how often garbage is collected, and the threads of numerical libraries.

Modules stay until a process ends, and the collector reads all objects again and again while they are loaded,
and once more at the end. That is a third of the processor time of a start and a stop of ``polhode serve``,
and frees nothing.
"""

import atexit
import gc
import os

_YOUNG, _MIDDLE, _OLD = 50_000, 20, 20
"""Objects that are made before the youngest are looked through, and how often that is until older ones are.

With Python's 700 a process of 500 000 objects has looked through them many times before it is loaded. Objects
without references are freed at once all the same: this is about circles of references only.
"""


def collect_seldom() -> None:
    """Collect less often, and not at the end, when the system takes the memory back. Called first of all."""
    gc.set_threshold(_YOUNG, _MIDDLE, _OLD)
    atexit.register(gc.freeze)


def keep_what_is_loaded() -> None:
    """Never look through the objects again that are there now.

    In the child of a fork this also saves memory: to look through an object writes to the page that it is on,
    which would then be copied.
    """
    gc.freeze()


def use_one_thread() -> None:
    """Have numerical libraries use one thread, unless the environment says otherwise.

    Slots share the cores already, the stacks of idle threads would count as a job's memory, and the last
    digits of a product of matrices may depend on how it is divided.
    """
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
