"""Lists every table, each after the tables that it refers to."""

from service.storage.tables.base import Base
from service.storage.tables.jobs import AttemptRow, AuditRow, JobRow, ResultRow
from service.storage.tables.labels import JobLabelRow, SolutionLabelRow, SweepLabelRow
from service.storage.tables.operations import (
    ApiKeyRow,
    CalibrationRow,
    ExaminationRow,
    IdempotencyKeyRow,
    WorkerRow,
)
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionNumberRow, SolutionRow
from service.storage.tables.sweeps import SweepChunkRow, SweepRow

TABLES: tuple[type[Base], ...] = (
    ApiKeyRow,
    IdempotencyKeyRow,
    WorkerRow,
    CalibrationRow,
    ExaminationRow,
    SolutionRow,
    SolutionNumberRow,
    DenseOutputRow,
    SamplesRow,
    SweepRow,
    SweepChunkRow,
    JobRow,
    AttemptRow,
    AuditRow,
    ResultRow,
    JobLabelRow,
    SolutionLabelRow,
    SweepLabelRow,
)

METADATA = Base.metadata
