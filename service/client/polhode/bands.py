"""A range of λ in an atlas: its parts, the windows followed over them, and the changes between."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polhode.documents.quantities import Quantity, fields, items
from polhode.evaluation import FloatArray

_PAIRS = ("g1", "g1_error", "g2", "g2_error")
_PERIODS = ("period", "period_error")


@dataclass(frozen=True, slots=True)
class Change:
    """A value of λ between two parts, where windows change.

    Parameters
    ----------
    lam
        λ, with the error within which the change is.
    kind
        As λ grows: ``window_appears``, ``windows_merge``, … as docs/atlas.md lists them.
    g1, g2
        Where on the curve, with estimated errors; None where that is not known.
    proof
        ``proved``, or ``seen``: the windows on both sides are seen, and differ.
    """

    lam: Quantity
    kind: str
    g1: Quantity | None
    g2: Quantity | None
    proof: str = "proved"


@dataclass(frozen=True, slots=True)
class Band:
    """One window followed over the λ of a part.

    Parameters
    ----------
    kind
        ``periodic``, or why the motion never comes back.
    ends
        What the window ends at, where |g1| is smallest and where it is largest.
    has_mirror_image
        There is another arc, with g2 → −g2, which counts as the same window.
    g1, g1_error
        g1 at the two ends, shape (2, λ), with bounds of its errors; NaN where it is not known.
    g2, g2_error
        The smallest and the largest g2 of the northern arc, shape (2, λ), and bounds of their errors.
    period, period_error
        Shape (λ,), with estimated errors; NaN where it is not known, or was not asked for.
    stability
        As the service tells it; None if the outputs did not ask for it.
    """

    window: int
    kind: str
    ends: tuple[str, str]
    has_mirror_image: bool
    g1: FloatArray
    g1_error: FloatArray
    g2: FloatArray
    g2_error: FloatArray
    period: FloatArray
    period_error: FloatArray
    stability: Mapping[str, object] | None


@dataclass(frozen=True, slots=True)
class Part:
    """A stretch of λ on which the number, kinds and ends of the windows stay the same.

    Parameters
    ----------
    lower, upper
        The ends of the stretch.
    lam, energy, energy_error
        The λ at which the windows are followed, and h there with bounds of its errors, shape (λ,).
    bands
        The windows; none where there is no motion.
    reason
        Why there are no windows, as ``code`` and ``detail``; else None.
    proof
        ``proved``, or ``seen``: at single λ, so that a window narrower than their distance can be missed.
    """

    lower: float
    upper: float
    lam: FloatArray
    energy: FloatArray
    energy_error: FloatArray
    bands: tuple[Band, ...]
    reason: Mapping[str, object] | None
    proof: str = "proved"


def read_part(document: Mapping[str, object]) -> Part:
    """Return a part from the service's document."""
    lower, upper = pair(document["lambda"])
    samples, reason, proof = document["samples"], document["reason"], str(document.get("proof", "proved"))
    if not isinstance(samples, Mapping):
        nothing: FloatArray = np.empty(0)
        return Part(lower, upper, nothing, nothing, nothing, (), fields(reason), proof)
    lam = _numbers(samples["lambda"])
    bands = tuple(_band(window, len(lam)) for window in items(samples["windows"]))
    return Part(
        lower, upper, lam, _numbers(samples["energy"]), _numbers(samples["energy_error"]), bands, None, proof
    )


def _band(document: Mapping[str, object], count: int) -> Band:
    first, second = items(document["ends"])
    stability = document.get("stability")
    unknown: FloatArray = np.full(count, np.nan)
    period, error = (unknown if document[name] is None else _numbers(document[name]) for name in _PERIODS)
    g1, g1_error, g2, g2_error = (
        np.stack([_numbers(each) for each in items(document[name])]) for name in _PAIRS
    )
    return Band(
        int(str(document["window"])),
        str(document["kind"]),
        (str(first), str(second)),
        bool(document["has_mirror_image"]),
        g1,
        g1_error,
        g2,
        g2_error,
        period,
        error,
        stability if isinstance(stability, Mapping) else None,
    )


def read_change(document: Mapping[str, object]) -> Change:
    """Return a change from the service's document."""
    lam = Quantity.read(document["lambda"])
    assert lam is not None
    return Change(
        lam,
        str(document["kind"]),
        Quantity.read(document["g1"]),
        Quantity.read(document["g2"]),
        str(document.get("proof", "proved")),
    )


def columns_of(parts: Sequence[Part]) -> dict[str, object]:
    """Return equally long columns, with the names of the service: a row for each window and λ."""
    rows = [(number, part, band) for number, part in enumerate(parts) for band in part.bands]
    found: dict[str, object] = {
        "part": _repeated(((number, len(part.lam)) for number, part, _ in rows)),
        "window": _repeated(((band.window, len(part.lam)) for _, part, band in rows)),
    }
    numbers = [_numbers_of(part, band) for _, part, band in rows]
    for name in _NUMBERS:
        found[name] = np.concatenate([each[name] for each in numbers]) if numbers else np.empty(0)
    for word, name in enumerate(("kind", "smallest_end", "largest_end", "proof")):
        words = ((band.kind, *band.ends, part.proof)[word] for _, part, band in rows)
        lengths = (len(part.lam) for _, part, _ in rows)
        found[name] = [word for word, count in zip(words, lengths, strict=True) for _ in range(count)]
    return found


def _numbers_of(part: Part, band: Band) -> dict[str, FloatArray]:
    found = {"lambda": part.lam, "energy": part.energy, "energy_error": part.energy_error}
    for name, values, errors in (("g1", band.g1, band.g1_error), ("g2", band.g2, band.g2_error)):
        for k, end in enumerate(("smallest", "largest")):
            found |= {f"{name}_{end}": values[k], f"{name}_{end}_error": errors[k]}
    return found | {"period": band.period, "period_error": band.period_error}


_ENDS = [
    f"{name}_{end}{what}"
    for name in ("g1", "g2")
    for end in ("smallest", "largest")
    for what in ("", "_error")
]
_NUMBERS = ("lambda", "energy", "energy_error", *_ENDS, *_PERIODS)


def _repeated(values: Iterable[tuple[int, int]]) -> NDArray[np.int64]:
    return np.array([value for value, count in values for _ in range(count)], dtype=np.int64)


def _numbers(value: object) -> FloatArray:
    """Return an array of numbers, NaN for null."""
    return np.array([np.nan if each is None else float(str(each)) for each in items(value)])


def pair(value: object) -> tuple[float, float]:
    """Return two numbers."""
    low, high = items(value)
    return float(str(low)), float(str(high))
