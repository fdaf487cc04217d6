"""The path parameters (ids), described once for all endpoints."""

from typing import Annotated

from fastapi import Path

JobId = Annotated[str, Path(description="Id of a job.")]
SolutionId = Annotated[str, Path(description="Id of a solution.")]
SweepId = Annotated[str, Path(description="Id of a sweep.")]
AtlasId = Annotated[str, Path(description="Id of an atlas, which is that of its job.")]
AuditId = Annotated[str, Path(description="Id of an audit, which is that of its job.")]
