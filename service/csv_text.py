"""Writes equally long columns as CSV, a block at a time.

It is above neither the service nor the workers, since both write the same text: the replies of
the API and the files of `polhode solve`. It knows no document, table or file. Text with a comma, a
quotation mark or the end of a line in it stands in quotation marks (RFC 4180).
"""

import re
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

CRLF = "\r\n"
"""The end of a line by RFC 4180, for replies."""
LF = "\n"
"""The end of a line in the other files of a Unix machine."""
_SPECIAL = re.compile(r'[",\r\n]')


def header_line(names: Iterable[str], line_end: str) -> str:
    """Return the line of the columns' names."""
    return ",".join(map(_cell, names)) + line_end


def data_lines(columns: Iterable[NDArray[np.generic]], line_end: str) -> str:
    """Return a line for each row of ``columns``, of shape (rows,) each; a NaN and a None are left empty.

    A double is written as the shortest decimal that reads back to the same double.
    """
    rows = zip(*(_cells(column) for column in columns), strict=True)
    return "".join(",".join(row) + line_end for row in rows)


def _cells(column: NDArray[np.generic]) -> Iterator[str]:
    if column.dtype.kind != "f":
        return map(_cell, column.tolist())
    # Only a NaN differs from itself.
    return ("" if value != value else repr(value) for value in column.tolist())


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    text = "" if value is None else str(value)
    return '"' + text.replace('"', '""') + '"' if _SPECIAL.search(text) else text
