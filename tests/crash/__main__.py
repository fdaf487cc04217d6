"""``python -m tests.crash [--minutes M] [--seed N]``: storms on both databases and by Procrastinate."""

import argparse
import sys

from tests.crash.storm import by_procrastinate, on_postgres, on_sqlite

JOBS_PER_SECOND = 10


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.crash", description=__doc__)
    parser.add_argument("--minutes", type=float, default=0.25, help="of each storm; then the waves settle")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    seconds = 60.0 * options.minutes
    jobs = int(seconds * JOBS_PER_SECOND)
    storms = {"SQLite": on_sqlite, "Postgres": on_postgres, "Procrastinate": by_procrastinate}
    for name, run in storms.items():
        figures = run(seed=options.seed, jobs=jobs, seconds=seconds)
        sys.stdout.write(f"{name}: {figures.line()}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
