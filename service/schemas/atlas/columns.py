"""Writes an atlas as columns: a row for each window and each λ at which it is followed."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from service.schemas.atlas.replies import AtlasOut, AtlasSamplesOut, AtlasWindowOut

FloatArray = NDArray[np.float64]

INTEGERS = ("part", "window")
NUMBERS = (
    "lambda",
    "energy",
    "energy_error",
    "g1_smallest",
    "g1_smallest_error",
    "g1_largest",
    "g1_largest_error",
    "g2_smallest",
    "g2_smallest_error",
    "g2_largest",
    "g2_largest_error",
    "period",
    "period_error",
)
WORDS = ("kind", "smallest_end", "largest_end", "proof")
"""The kind of the motion, the ends of the window where |g1| is smallest and largest, and whether the part is
proved or seen."""


def atlas_columns(atlas: AtlasOut) -> dict[str, NDArray[np.generic]]:
    """Return equally long columns; NaN where a number is not known."""
    rows = [
        (number, part, part.samples, window)
        for number, part in enumerate(atlas.parts)
        if part.samples is not None
        for window in part.samples.windows
    ]
    columns: dict[str, NDArray[np.generic]] = {
        "part": _joined([np.full(len(samples.lambda_), number) for number, _, samples, _ in rows], np.int64),
        "window": _joined(
            [np.full(len(samples.lambda_), window.window) for _, _, samples, window in rows], np.int64
        ),
    }
    numbers = [_numbers(samples, window) for _, _, samples, window in rows]
    for k, name in enumerate(NUMBERS):
        columns[name] = _joined([each[k] for each in numbers], np.float64)
    words = [
        (window.kind, *window.ends, part.proof) for _, part, samples, window in rows for _ in samples.lambda_
    ]
    for k, name in enumerate(WORDS):
        columns[name] = np.array([each[k] for each in words], dtype=np.str_)
    return columns


def _numbers(samples: AtlasSamplesOut, window: AtlasWindowOut) -> list[FloatArray]:
    nothing: list[float | None] = [None] * len(samples.lambda_)
    given: list[Sequence[float | None]] = [
        samples.lambda_,
        samples.energy,
        samples.energy_error,
        window.g1[0],
        window.g1_error[0],
        window.g1[1],
        window.g1_error[1],
        window.g2[0],
        window.g2_error[0],
        window.g2[1],
        window.g2_error[1],
        window.period or nothing,
        window.period_error or nothing,
    ]
    return [np.array([np.nan if value is None else value for value in values]) for values in given]


def _joined(parts: Sequence[NDArray[np.generic]], kind: type[np.generic]) -> NDArray[np.generic]:
    return np.concatenate(parts).astype(kind) if parts else np.array([], dtype=kind)
