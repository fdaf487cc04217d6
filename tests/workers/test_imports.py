"""A worker never loads the web framework.

The import graph of the linter does not count a parent package's own module;
a fresh interpreter does.
"""

import subprocess
import sys

CODE = """
import sys
import workers.__main__, workers.commands, workers.runner, workers.computation
print(*{name.partition(".")[0] for name in sys.modules} & {"fastapi", "starlette", "uvicorn"})
"""


def test_a_worker_loads_no_http():
    result = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert result.stdout.split() == []
