"""Every table, in an order in which each comes after those it refers to."""

from service.storage.base import Base
from service.storage.operation_tables import ApiKeyRow, CalibrationRow, WorkerRow
from service.storage.sweep_tables import SweepChunkRow, SweepRow
from service.storage.tables import AttemptRow, DenseOutputRow, JobRow, SamplesRow, SolutionRow

TABLES: tuple[type[Base], ...] = (
    ApiKeyRow,
    WorkerRow,
    CalibrationRow,
    SolutionRow,
    DenseOutputRow,
    SamplesRow,
    SweepRow,
    SweepChunkRow,
    JobRow,
    AttemptRow,
)

METADATA = Base.metadata
