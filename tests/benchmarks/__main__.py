"""``make bench``: what things cost, rivals side by side, each with its error.

Prints all tables and writes them into their places in docs/performance.md and docs/index.md, with the
picture and with what ``GET /v1/accuracy`` ships. ``python -m tests.benchmarks PART ...`` measures and writes
these parts alone; ``--quick`` measures less, prints, and writes nothing; ``--against FOLDER`` times whole
jobs of another revision that is checked out there, and its start where it is installed there, in turns with
ours, and writes nothing.
"""

import argparse
import sys
import time
from pathlib import Path

from service.startup import collect_seldom
from tests.benchmarks.against import against
from tests.benchmarks.measuring import Effort, circumstances, say
from tests.benchmarks.parts import PARTS
from tests.benchmarks.report import text_of_table
from tests.benchmarks.starting import starting_against
from workers.computation.compiled_code import keep_compiled_code


def main() -> int:
    """Measure, print, write; 0 whether the targets are reached or not."""
    # As every worker does first of all.
    collect_seldom()
    keep_compiled_code()
    options = argparse.ArgumentParser(prog="python -m tests.benchmarks")
    options.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; all without")
    options.add_argument("--quick", action="store_true", help="fewer and shorter runs; nothing is written")
    options.add_argument("--against", type=Path, metavar="FOLDER", help="another revision, checked out there")
    arguments = options.parse_args()
    unknown = set(arguments.parts) - set(PARTS)
    if unknown:
        options.error(f"unknown: {', '.join(sorted(unknown))}; the parts are {', '.join(PARTS)}")
    effort, began, known = Effort(arguments.quick), time.perf_counter(), circumstances()
    for line in known:
        say(line)
    if arguments.against:
        say(text_of_table(against(arguments.against, effort)))
        if (command := arguments.against.resolve() / ".venv" / "bin" / "polhode").exists():
            say(text_of_table(starting_against(command, effort)))
    else:
        for name in arguments.parts or PARTS:
            start = time.perf_counter()
            PARTS[name](effort, known)
            say(f"{name}: {time.perf_counter() - start:.0f} s")
    say(f"{time.perf_counter() - began:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
