"""Samples of a motion at some times, each with the bound of its error."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polhode.documents.problems import nearest
from polhode.errors import PolhodeError

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]


class MissingLibraryError(PolhodeError, ImportError):
    """An optional library is not installed."""


def optional(library: str, for_what: str) -> ModuleType:
    """Return an optional library.

    Raises
    ------
    MissingLibraryError
        It is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(library)
    except ImportError as fault:
        top = library.partition(".")[0]
        raise MissingLibraryError(f"{for_what} needs {top}: pip install {top}") from fault


@dataclass(frozen=True, slots=True)
class Samples:
    """Columns of equal length by name: ``t``, ``p``, ``q``, ``r``, ``g1``, ``g2``, ``g3`` and others.

    Parameters
    ----------
    errors
        For each column the bound of the absolute error of any number in it.
    """

    columns: Mapping[str, FloatArray]
    errors: Mapping[str, float]

    @property
    def error(self) -> float:
        """Bound of the absolute error of any number."""
        return max(self.errors.values(), default=0.0)

    @property
    def t(self) -> FloatArray:
        """Times, shape (n,)."""
        return self["t"]

    @property
    def omega(self) -> FloatArray:
        """Angular velocity (p, q, r) in the axes of the body, shape (n, 3)."""
        return np.stack([self[name] for name in ("p", "q", "r")], axis=-1)

    @property
    def gamma(self) -> FloatArray:
        """The vertical (g1, g2, g3) in the axes of the body, shape (n, 3)."""
        return np.stack([self[name] for name in ("g1", "g2", "g3")], axis=-1)

    def __getitem__(self, name: str) -> FloatArray:
        if name not in self.columns:
            known = list(self.columns)
            raise KeyError(f"no column {name!r}{nearest(name, known)}; there are {', '.join(known)}")
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["t"])

    def __repr__(self) -> str:
        return f"<{len(self)} samples of {', '.join(self.columns)}; error {self.error:.1e}>"

    def frame(self) -> "pd.DataFrame":
        """Return a pandas frame with a row a time; ``frame.attrs["error"]`` bounds every number's error."""
        pandas: ModuleType = optional("pandas", "frame()")
        frame: pd.DataFrame = pandas.DataFrame(dict(self.columns))
        frame.attrs.update(error=self.error, errors=dict(self.errors))
        return frame
