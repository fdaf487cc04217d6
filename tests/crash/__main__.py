"""``python -m tests.crash [NAME ...] [--minutes M] [--kills K]``: all storms, or those that are named."""

import argparse
import os
import sys

from tests.crash.storm import Plan, on_postgres, on_sqlite, on_two_hosts

JOBS_PER_SECOND = 10
STORMS = {"SQLite": on_sqlite, "Postgres": on_postgres, "TwoHosts": on_two_hosts}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.crash", description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *STORMS])
    parser.add_argument("--minutes", type=float, default=0.25, help="of each storm; then the waves settle")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kills", type=int, default=0, help="go on until so many are killed")
    options = parser.parse_args()
    seconds = 60.0 * options.minutes
    plan = Plan(options.seed, int(seconds * JOBS_PER_SECOND), seconds, options.kills)
    for name in options.names or STORMS:
        sys.stdout.write(f"{name}, load {os.getloadavg()[0]:.0f}: {STORMS[name](plan).line()}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
