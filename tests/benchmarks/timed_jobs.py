"""Times the jobs on its input by the code of the revision whose folder is first on the path.

Started by :mod:`.against`. It knows nothing of that revision but the function that solves a document.
"""

import importlib
import inspect
import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import workers

WARM = 3
"""Jobs that are not counted."""


def solver() -> Callable[..., object]:
    """Return what solves a document, which has moved once."""
    try:
        module = importlib.import_module("workers.computation.compute")
    except ModuleNotFoundError:
        module = importlib.import_module("workers.computation")
    found: Callable[..., object] = module.solve_document
    return found


def main() -> None:
    solve, jobs = solver(), json.load(sys.stdin)
    takes_windows = "windows_json" in inspect.signature(solve).parameters
    taken = []
    for document, windows in [*jobs[-WARM:], *jobs]:
        arguments = (document, windows) if takes_windows else (document,)
        began = time.process_time()
        outcome = solve(*arguments)
        taken.append(time.process_time() - began)
        refused = getattr(outcome, "error", None)
        if refused:
            sys.exit(f"refused: {refused}")
    code = Path(next(iter(workers.__path__)))
    sys.stdout.write(json.dumps({"seconds": statistics.median(taken[WARM:]), "code": str(code)}))


if __name__ == "__main__":
    main()
