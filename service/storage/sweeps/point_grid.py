"""A kept number of a sweep on two of its axes, as a matrix."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.schemas.sweep.sweep import Sweep
from service.storage.sweeps.point_reader import PointReader

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
WordArray = NDArray[np.object_]


@dataclass(frozen=True, slots=True)
class PointGrid:
    """The cells, of shape [rows, columns]: of a sweep of one axis there is one row."""

    indices: IntArray
    """Indices of the points."""
    numbers: FloatArray
    """NaN where a point has none, or is not computed yet."""
    outcomes: WordArray
    """None where a point is not computed yet."""


def cell_indices(sweep: Sweep, at: Mapping[int, int]) -> IntArray:
    """Return the indices of the points of the cells; they grow along a row and from row to row.

    ``at`` has for each axis but one or two, by its place among the axes, the place on it.
    """
    lengths = [each.axis.length for each in sweep.axes]
    # In a grid the last axis runs fastest.
    strides = [int(np.prod(lengths[place + 1 :], dtype=np.int64)) for place in range(len(lengths))]
    first = sum(at[place] * strides[place] for place in at)
    *rows, columns = [place for place in range(len(lengths)) if place not in at]
    indices: IntArray = first + strides[columns] * np.arange(lengths[columns], dtype=np.int64)[None, :]
    for place in rows:
        indices = indices + strides[place] * np.arange(lengths[place], dtype=np.int64)[:, None]
    return indices


def read_grid(reader: PointReader, indices: IntArray, name: str) -> PointGrid:
    """Return the number ``name`` of the points that are computed, read a block at a time."""
    wanted = indices.ravel()
    numbers, outcomes = np.full(len(wanted), np.nan), np.full(len(wanted), None, dtype=np.object_)
    for block in reader.among(wanted):
        cells: NDArray[np.intp] = np.searchsorted(wanted, block.indices)
        numbers[cells] = block.column(name)
        outcomes[cells] = block.outcomes
    return PointGrid(indices, numbers.reshape(indices.shape), outcomes.reshape(indices.shape))
