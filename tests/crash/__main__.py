"""``python -m tests.crash [--minutes M] [--seed N]``: a storm on SQLite and one on Postgres, in figures."""

import argparse
import sys

from tests.crash.storm import on_postgres, on_sqlite

JOBS_PER_SECOND = 10


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.crash", description=__doc__)
    parser.add_argument("--minutes", type=float, default=0.25, help="of each storm; then the waves settle")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    seconds = 60.0 * options.minutes
    jobs = int(seconds * JOBS_PER_SECOND)
    for name, run in (("SQLite", on_sqlite), ("Postgres", on_postgres)):
        figures = run(seed=options.seed, jobs=jobs, seconds=seconds)
        sys.stdout.write(f"{name}: {figures.line()}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
