"""A worker never loads the web framework.

The import graph of the linter does not count a parent package's own module;
a fresh interpreter does.
"""

import subprocess
import sys

CODE = """
import sys
import workers.__main__, workers.cli.main, workers.process.runner, workers.computation.compute
print(*{name.partition(".")[0] for name in sys.modules} & {"fastapi", "starlette", "uvicorn"})
"""

COMPUTING = """
import sys
import workers.cli.main, workers.cli.documents, workers.process.start
names = {name.partition(".")[0] for name in sys.modules} & {"heyoka", "scipy", "sympy", "numba", "pyarrow"}
print(*names, *({"workers.computation.compute", "workers.solvers"} & set(sys.modules)))
"""


def test_a_worker_and_a_command_are_there_before_the_solvers_are_loaded():
    result = subprocess.run([sys.executable, "-c", COMPUTING], capture_output=True, text=True, check=True)
    assert result.stdout.split() == []


CALLING = """
import contextlib, importlib, sys
from workers.process import tasks
for name in tasks.PRELOAD:
    importlib.import_module(name)
before = set(sys.modules)
most = (tasks.solve_problem, tasks.solve_chunk, lambda document: tasks.solve_examined(document, "{}"))
for computation in most:
    with contextlib.suppress(Exception):
        computation("{}")
print(*(set(sys.modules) - before))
"""


def test_the_fork_server_loads_what_its_children_call():
    """Else each child would load the solvers by itself, at its first job."""
    result = subprocess.run([sys.executable, "-c", CALLING], capture_output=True, text=True, check=True)
    assert result.stdout.split() == []


def test_a_worker_loads_no_http():
    result = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert result.stdout.split() == []
