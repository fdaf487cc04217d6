"""``python -m tests.benchmarks.whole [--quick]``: of ``make bench`` the part on whole jobs and requests."""

import argparse

from tests.benchmarks import report
from tests.benchmarks.measuring import Effort, circumstances, say
from tests.benchmarks.whole import jobs, points, requests, tiers
from workers.computation.compiled_code import keep_compiled_code


def main() -> None:
    """Measure and print; nothing is written."""
    keep_compiled_code()
    options = argparse.ArgumentParser(prog="python -m tests.benchmarks.whole")
    options.add_argument("--quick", action="store_true", help="fewer and shorter runs")
    effort = Effort(options.parse_args().quick)
    for line in circumstances():
        say(line)
    for measure in (jobs.jobs, points.points, requests.requests, tiers.tiers):
        say(report.text_of_table(measure(effort)))


if __name__ == "__main__":
    main()
