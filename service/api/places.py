"""The parts of paths that name something stored, described once for all endpoints."""

from typing import Annotated

from fastapi import Path

JobId = Annotated[str, Path(description="Id of a job.")]
SolutionId = Annotated[str, Path(description="Id of a solution.")]
SweepId = Annotated[str, Path(description="Id of a sweep.")]
