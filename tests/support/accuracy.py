"""Tables of accuracy and speed in few words, for tests."""

from service.dynamics.accuracy import AccuracyRow, AccuracyTable, Machine, Unavailable
from service.dynamics.numerics import NUMERICS


def row(
    tier="standard", kind="rest to rest", family="three-term", *, seconds=0.1, seconds_per_1000=0.01
) -> AccuracyRow:
    return AccuracyRow(tier, kind, family, 2e-14, 1e-15, "certified", 1e-32, seconds, seconds_per_1000)


def table(*rows: AccuracyRow, version: str = "1", numerics: int = NUMERICS) -> AccuracyTable:
    return AccuracyTable(
        source="measured",
        date="2026-01-02T03:04:05Z",
        version=version,
        numerics=numerics,
        machine=Machine(2, None, "Linux x86_64"),
        repetitions=3,
        rows=rows or (row(),),
        unavailable=(Unavailable("certified", "aperiodic", "rational", "no_way", "There is none."),),
    )
