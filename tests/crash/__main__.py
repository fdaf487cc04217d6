"""``python -m tests.crash [NAME ...] [--minutes M] [--kills K]``: all storms, or those that are named."""

import argparse
import os
import sys

from tests.crash.storm import Plan, on_cluster, on_cluster_and_postgres, on_postgres, on_sqlite, on_two_hosts

JOBS_PER_SECOND = 10
STORMS = {
    "SQLite": on_sqlite,
    "Postgres": on_postgres,
    "TwoHosts": on_two_hosts,
    "Cluster": on_cluster,
    "ClusterAndPostgres": on_cluster_and_postgres,
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.crash", description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *STORMS])
    parser.add_argument("--minutes", type=float, default=0.25, help="of each storm; then the waves settle")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kills", type=int, default=0, help="go on until so many are killed")
    parser.add_argument("--jobs", type=int, default=0, help="so many in place of 10 a second")
    parser.add_argument("--pause", type=float, default=0.4, help="seconds between two kills, in the mean")
    options = parser.parse_args()
    seconds = 60.0 * options.minutes
    jobs = options.jobs or int(seconds * JOBS_PER_SECOND)
    plan = Plan(options.seed, jobs, seconds, options.kills, options.pause)
    for name in options.names or STORMS:
        sys.stdout.write(f"{name}, load {os.getloadavg()[0]:.0f}: {STORMS[name](plan).line()}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
