"""Atlases: all planar motions of a body and a potential over a range of λ.

The range has parts, windows that are followed over them, and changes between.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Generic

import numpy as np
from numpy.typing import NDArray

from polhode.documents.problems import Body, Document, Given, question
from polhode.documents.quantities import Exact, Quantity, fields, items, written
from polhode.errors import FailedError, PolhodeError
from polhode.evaluation import FloatArray, optional
from polhode.transport.carriers import CarrierT, ThreadCarrier
from polhode.transport.exchange import ask, ask_json, follow
from polhode.transport.terms import Operation, Terms, operation

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa


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


SVG = "image/svg+xml"
WAIT_SECONDS = 20
"""Seconds for which the service holds a request whose atlas a job draws; proxies may end longer ones."""
_ACCEPTED = 202


class Atlas(Generic[CarrierT]):
    """All planar motions over a range of λ.

    Attributes
    ----------
    document
        The atlas as the service tells it.
    question
        The document that it answers; None of an atlas that was asked for by its id.
    id
        Of the stored atlas, if a job has drawn it; else None.
    """

    def __init__(
        self, carrier: CarrierT, document: Document, question: Document | None, stored: str | None
    ) -> None:
        self.carrier, self.document, self.question, self.id = carrier, document, question, stored
        self._picture: str | None = None

    @property
    def verdict(self) -> str:
        """``admissible``, or ``undecided`` if such a potential was accepted."""
        return str(self.document["verdict"])

    @property
    def lam(self) -> tuple[float, float]:
        """The range of λ."""
        return pair(self.document["lambda"])

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts between the changes, in the order of growing λ."""
        return tuple(map(read_part, items(self.document["parts"])))

    @property
    def changes(self) -> tuple[Change, ...]:
        """The changes: outside of them and of ``undecided`` there is none, where ``proof`` is ``proved``."""
        return tuple(map(read_change, items(self.document["changes"])))

    @property
    def undecided(self) -> tuple[tuple[float, float], ...]:
        """Stretches of λ on which nothing is proved."""
        return tuple(map(pair, items(self.document["undecided"])))

    def table(self) -> "pa.Table":
        """Return a row for each window and λ as an Arrow table, with the names of the service."""
        # It takes longer to load than all else that a command needs.
        import pyarrow as pa  # noqa: PLC0415

        return pa.table(columns_of(self.parts))

    def frame(self) -> "pd.DataFrame":
        """Return a row for each window and λ as a pandas frame, with the names of the service."""
        pandas = optional("pandas", "frame()")
        frame: pd.DataFrame = pandas.DataFrame(columns_of(self.parts))
        return frame

    @operation
    def svg(self) -> Operation[str]:
        """Return the service's picture: windows as bands over λ, energies and periods."""
        return (yield from self._drawn())

    def _drawn(self) -> Operation[str]:
        if self._picture is None:
            terms = self.carrier.terms
            if self.id is None:
                reply = yield from ask(terms, "POST", "/v1/atlases", self.question, accept=SVG)
                if reply.status == _ACCEPTED:
                    # The service is busier than when it answered at once.
                    self.id = yield from _stored(terms, json.loads(reply.content), None)
            if self.id is not None:
                reply = yield from ask(terms, "GET", f"/v1/atlases/{self.id}", accept=SVG)
            self._picture = reply.content.decode()
        return self._picture

    def __repr__(self) -> str:
        low, high = self.lam
        counts = f"{len(self.parts)} parts, {len(self.changes)} changes"
        open_ = f", {len(self.undecided)} stretches undecided" if self.undecided else ""
        return f"<atlas of λ from {low:g} to {high:g}: {counts}{open_}>"

    def _repr_svg_(self) -> str | None:
        if isinstance(self.carrier, ThreadCarrier):
            try:
                return self.carrier.run(partial(Atlas._drawn, self)())
            except PolhodeError:
                return None  # the words of repr() are better than nothing
        return self._picture


def atlas_question(
    potential: str | Given,
    *,
    body: Body | None = None,
    lam: Sequence[Exact] | None = None,
    outputs: Sequence[str] | None = None,
    samples: int | None = None,
    g1_sign: int | None = None,
    g3_sign: int | None = None,
    accept: str | None = None,
    numbers: Mapping[str, Exact],
) -> Document:
    """Return the document that asks for an atlas; what is None is left as it is."""
    asked = question(potential, body=body, numbers=numbers)
    given = {
        "lambda": lam,
        "outputs": outputs,
        "samples": samples,
        "g1_sign": g1_sign,
        "g3_sign": g3_sign,
        "accept": accept,
    }
    return asked | {name: written(value) for name, value in given.items() if value is not None}


def draw(carrier: CarrierT, question: Document, seconds: float | None) -> Operation[Atlas[CarrierT]]:
    """Return the atlas, at once or after the job that draws it has ended.

    Raises
    ------
    FailedError
        The job failed or was cancelled.
    UnfinishedError
        It took longer than ``seconds``; it goes on.
    """
    terms = carrier.terms
    wait = WAIT_SECONDS if seconds is None else min(int(seconds), WAIT_SECONDS)
    reply = yield from ask(
        terms, "POST", "/v1/atlases", question, headers={"Prefer": f"wait={wait}"} if wait else {}
    )
    document: Document = json.loads(reply.content)
    if reply.status != _ACCEPTED:
        return Atlas(carrier, document, question, None)
    return (yield from stored_atlas(carrier, (yield from _stored(terms, document, seconds)), question))


def stored_atlas(
    carrier: CarrierT, atlas_id: str, question: Document | None = None
) -> Operation[Atlas[CarrierT]]:
    """Return an atlas that a job has drawn, for ``question`` if that is known.

    Raises
    ------
    MissingError
        There is none of this id.
    """
    document = yield from ask_json(carrier.terms, "GET", f"/v1/atlases/{atlas_id}")
    return Atlas(carrier, document, question, atlas_id)


def _stored(terms: Terms, job: Document, seconds: float | None) -> Operation[str]:
    """Return the id of the atlas that a job has drawn, once it has ended."""
    job = yield from follow(terms, f"/v1/jobs/{job['id']}", job, seconds=seconds)
    if job.get("state") != "succeeded":
        raise FailedError(job)
    return str(job["atlas"])
