"""Atlases: all planar motions of a body and a potential over a range of λ."""

import json
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Generic

from polhode.bands import Change, Part, columns_of, pair, read_change, read_part
from polhode.documents.problems import Body, Document, Given, question
from polhode.documents.quantities import Exact, items, written
from polhode.errors import FailedError, PolhodeError
from polhode.evaluation import optional
from polhode.transport.carriers import CarrierT, ThreadCarrier
from polhode.transport.exchange import ask, ask_json, follow
from polhode.transport.steps import Operation, operation
from polhode.transport.terms import Terms

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

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
