"""Writes arrays as a file of NumPy (NPZ) with any names."""

import io
import zipfile
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

NOT_COMPUTED = -1
"""The code of a point without an outcome."""


def npz_file(arrays: Mapping[str, NDArray[np.generic]]) -> bytes:
    """Return an archive of arrays; a pointer such as /body/A is called body/A in it."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        # Not np.savez: a pointer such as /body/A is no name of its parameters, nor of a file.
        for name, values in arrays.items():
            with file.open(f"{name.lstrip('/')}.npy", "w") as member:
                np.lib.format.write_array(member, np.ascontiguousarray(values), allow_pickle=False)
    return buffer.getvalue()


def coded(words: NDArray[np.object_]) -> tuple[NDArray[np.int16], NDArray[np.str_]]:
    """Return for each word its place in the list of the words that occur, and that list.

    The place of None is ``NOT_COMPUTED``. As text of fixed length a million words would be 40 MB.
    """
    flat: list[str | None] = words.ravel().tolist()
    found = dict.fromkeys(word for word in flat if word is not None)
    places: dict[str | None, int] = {None: NOT_COMPUTED}
    places.update((word, place) for place, word in enumerate(found))
    codes = np.fromiter(map(places.__getitem__, flat), dtype=np.int16, count=len(flat))
    return codes.reshape(words.shape), np.array(list(found), dtype=np.str_)
