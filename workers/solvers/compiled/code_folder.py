"""The folder in which compiled code is kept. It is passed in: this package reads no environment and no files.

Whoever may do so (:mod:`workers.computation.compiled_code`) hands the folder in, before or after kernels were
loaded. Until then nothing is kept: what is compiled is compiled for this process alone.
"""

from collections.abc import Callable


class OtherFolderError(RuntimeError):
    """Another folder was named before, and kernels keep their code there."""


class _Told:
    folder: str | None = None


_waiting: list[Callable[[str], None]] = []


def hand_in(folder: str | None) -> None:
    """Say where compiled code is kept; None: nowhere.

    Raises
    ------
    OtherFolderError
        Another folder was named before.
    """
    if folder == _Told.folder:
        return
    if folder is None or _Told.folder is not None:
        raise OtherFolderError(f"compiled code is kept in {_Told.folder} already, not in {folder}")
    _Told.folder = folder
    for keep in _waiting:
        keep(folder)
    _waiting.clear()


def when_named(keep: Callable[[str], None]) -> None:
    """Call ``keep`` with the folder: now, or as soon as it is named."""
    if _Told.folder is None:
        _waiting.append(keep)
    else:
        keep(_Told.folder)
