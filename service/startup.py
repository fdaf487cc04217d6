"""The first steps of every process, and a list of what makes starts short, by the processor time it saves.

* Garbage is collected seldom, here and in :mod:`service.gc_tuning` for fork servers: 0.7 s of 2.5 s of
  ``polhode serve``, 0.2 s of 0.8 s of a worker, 0.5 s of 1.8 s of its fork server, 0.1 s of 0.7 s of that for
  verdicts. Modules stay until a process ends, and the collector would read all objects again and again while
  they are loaded, and once more at the end.
* A fork server loads the libraries once, and compiled code too (:mod:`workers.process.preloaded`): 1.4 s for
  every child but the first.
* It loads late what first jobs seldom need (:mod:`workers.process.tasks`): first children come 0.4 s earlier.
* Children start before their parent loads the database, or the web framework (:mod:`workers.process.start`,
  :mod:`service.cli.server`): 0.4 s and 1.4 s of a second processor.
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
