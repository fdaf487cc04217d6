"""A solved motion: its numbers with their errors, the motion as a function of time, and its audits."""

import math
import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Generic, Literal

import numpy as np
from numpy.typing import ArrayLike

from polhode import drawing, evaluation
from polhode.documents.problems import Document, audit_of
from polhode.documents.quantities import Exact, Quantity, fields, items, whole
from polhode.drawing import sphere_svg, table_html
from polhode.errors import FailedError, PolhodeError, WrongArgumentError
from polhode.evaluation import FloatArray, FunctionOfTime, PairOfDoubles, Samples
from polhode.transport.carriers import CarrierT, ThreadCarrier
from polhode.transport.exchange import ARROW, FINAL, ask, ask_json, follow
from polhode.transport.terms import Operation, Terms, operation

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WAIT_SECONDS = 20


class Audit:
    """A comparison of a stored motion with the same one solved again.

    Attributes
    ----------
    document
        The audit as the service describes it.
    """

    def __init__(self, document: Document) -> None:
        self.document = document

    @property
    def agrees(self) -> bool:
        """Whether all stored numbers are confirmed within the errors that both claim."""
        return self.document["verdict"] == "agrees"

    @property
    def detail(self) -> str:
        """The result in words."""
        return str(fields(self.document["comparison"])["detail"])

    def __repr__(self) -> str:
        return f"<audit {self.document['id']}: {self.document['verdict']}, {self.detail}>"


def audited(terms: Terms, solution_id: str, document: Document, seconds: float | None) -> Operation[Audit]:
    """Have a solution audited, and return the audit when it has ended."""
    path = f"/v1/solutions/{solution_id}/audits"
    wait = _WAIT_SECONDS if seconds is None else min(int(seconds), _WAIT_SECONDS)
    headers = {"Prefer": f"wait={wait}"} if wait else {}
    audit = yield from ask_json(terms, "POST", path, document, headers=headers)
    if audit["state"] not in FINAL:
        yield from follow(terms, f"/v1/jobs/{audit['id']}", seconds=seconds)
        audit = yield from ask_json(terms, "GET", f"{path}/{audit['id']}")
    if audit["comparison"] is None:
        raise FailedError(audit)
    return Audit(audit)


_ERROR_HEADER = "polhode-error"
_PICTURE_POINTS = 400


class Motion(Generic[CarrierT]):
    """A motion that the service has computed and stored.

    Attributes
    ----------
    document
        The summary as the service tells it, with everything that has no attribute here.
    """

    def __init__(self, carrier: CarrierT, document: Document) -> None:
        self.carrier, self.document = carrier, document
        self._function: FunctionOfTime | None = None

    @property
    def id(self) -> str:
        """Id of the solution."""
        return str(self.document["id"])

    @property
    def problem(self) -> Mapping[str, object]:
        """The document that was solved."""
        return fields(self.document["problem"])

    @property
    def period(self) -> Quantity | None:
        """Period of all six variables; None if there is none, or none is known."""
        return Quantity.read(self.document.get("period"))

    @property
    def energy(self) -> Quantity:
        """h, in the unit of moments over squared times."""
        energy = Quantity.read(self.document["energy"])
        assert energy is not None
        return energy

    @property
    def error(self) -> float:
        """Bound of the absolute error of each of the six variables over the times of the problem."""
        return float(str(self.document["error"]))

    @property
    def errors(self) -> Mapping[str, Mapping[str, float | None]]:
        """The same of ``omega`` and ``gamma`` alone, ``absolute`` and ``relative`` to their largest values.

        With the orientation also of ``quaternion``, ``psi1`` and ``psi3``; empty where there are none.
        """
        errors = self.document.get("errors")
        return errors if isinstance(errors, Mapping) else {}

    @property
    def error_kind(self) -> Mapping[str, str]:
        """The kind of each error by the path of its number: ``theorem``, ``estimate`` or ``difference``.

        ``samples`` are those of the problem, ``function`` any others; empty of solutions of earlier versions.
        """
        kinds = self.document.get("error_kind")
        return kinds if isinstance(kinds, Mapping) else {}

    @property
    def aperiodic(self) -> str | None:
        """Why it has no period: ``separatrix``, ``equilibrium``, ``collision`` or ``pole``."""
        reason = self.document.get("aperiodic")
        return None if reason is None else str(reason)

    @property
    def tier(self) -> str:
        """The tier of accuracy."""
        return str(self.document["tier"])

    @property
    def method(self) -> str:
        """The method of computation: ``quadrature`` or ``integration``."""
        return str(self.document["method"])

    @property
    def way(self) -> str:
        """``compiled``, or ``plain``: as accurate, before the solvers of that machine were compiled."""
        provenance = self.document.get("provenance")
        is_plain = isinstance(provenance, Mapping) and provenance.get("way") == "plain"
        return "plain" if is_plain else "compiled"

    @property
    def stability(self) -> Mapping[str, object] | None:
        """Whether small disturbances leave the plane, if the outputs asked for it."""
        stability = self.document.get("stability")
        return stability if isinstance(stability, Mapping) else None

    @property
    def labels(self) -> Mapping[str, str]:
        """The labels of the solution."""
        return fields(self.document["labels"])

    @operation
    def at(self, times: ArrayLike) -> Operation[Samples]:
        """Return the variables at any times, evaluated here with the bits of the service.

        Parameters
        ----------
        times
            One, or an array of any shape, which the columns have too; up to ±1e15.

        Raises
        ------
        WrongArgumentError
            A time is no finite number or too far away; or the motion has no period, and a time is outside
            the range that was computed.
        """
        return (yield from self._at(times))

    @operation
    def function(self) -> Operation[FunctionOfTime]:
        """Return the motion as a function of time; it is fetched once."""
        return (yield from self._fetched())

    @operation
    def samples(self) -> Operation[Samples]:
        """Return the samples at the times of the problem, as they are stored."""
        return (yield from self._stored())

    @operation
    def frame(self, times: ArrayLike | None = None) -> Operation["pd.DataFrame"]:
        """Return a pandas frame with a row a time: those of the problem if ``times`` is left out."""
        samples = (yield from self._stored()) if times is None else (yield from self._at(times))
        return samples.frame()

    @operation
    def enclosures(self) -> Operation[Mapping[str, object]]:
        """Return the proven samples of the tier certified: decimals with radii.

        Raises
        ------
        MissingError
            The motion is of another tier.
        """
        return (yield from ask_json(self.carrier.terms, "GET", f"/v1/solutions/{self.id}/enclosures"))

    @operation
    def citation(self, file_format: Literal["bibtex", "cff"] = "bibtex") -> Operation[str]:
        """Return how to cite the motion in a paper: as BibTeX, or as a citation file (CFF)."""
        path = f"/v1/solutions/{self.id}/citation?format={file_format}"
        return (yield from ask(self.carrier.terms, "GET", path, accept="*/*")).content.decode()

    @operation
    def audit(
        self,
        *,
        tier: str | None = None,
        tolerance: Exact | None = None,
        relative: Exact | None = None,
        method: str | None = None,
        seconds: float | None = None,
    ) -> Operation[Audit]:
        """Have the problem solved again, and tell how the two compare; what is left out is the same.

        Raises
        ------
        FailedError
            It was not solved again.
        UnfinishedError
            It took longer than ``seconds``; it goes on.
        WrongArgumentError
            Two of a tier, a tolerance and a relative one.
        """
        asked = audit_of(tier, tolerance, relative, method)
        return (yield from audited(self.carrier.terms, self.id, asked, seconds))

    @operation
    def plot(
        self, columns: Sequence[str] = ("g1", "g2", "g3", "p", "r"), *, ax: "Axes | None" = None
    ) -> Operation["Axes"]:
        """Draw columns over time, one period or the times of the problem, with matplotlib."""
        samples = yield from self._whole()
        return drawing.curves(samples, columns, ax)

    @operation
    def figure(self, file: str | os.PathLike[str] | None = None) -> Operation["Figure"]:
        """Draw γ and ω over time and the path on the sphere, as a figure for a paper, with matplotlib.

        Parameters
        ----------
        file
            Where to write it: SVG, PDF, PNG and others, by the end of the name.
        """
        samples = yield from self._whole()
        return drawing.figure(samples, self.period, file)

    @operation
    def animate(
        self, file: str | os.PathLike[str] | None = None, *, frames: int = 100, seconds: float = 5.0
    ) -> Operation[Path | drawing.Animation]:
        """Let the figure move, over one period or the times of the problem, with matplotlib.

        Parameters
        ----------
        file
            A .gif, a .html with buttons, or where there is ffmpeg a .mp4; without one a notebook shows it.
        frames, seconds
            The number of pictures, 2 to 400, and how long they are shown altogether.

        Raises
        ------
        WrongArgumentError
            The file is of another kind, or numbers are out of range.
        """
        if not (2 <= whole(frames, "frames") <= _PICTURE_POINTS and 0 < seconds < math.inf):
            raise WrongArgumentError(
                f"frames = {frames}, seconds = {seconds}; 2 to {_PICTURE_POINTS} frames in more than 0 s are"
                " accepted"
            )
        samples = yield from self._whole()
        return drawing.animation(samples, self.period, file, frames, seconds)

    @operation
    def sphere(self, *, ax: "Axes | None" = None) -> Operation["Axes"]:
        """Draw the path of the vertical on the unit sphere, seen from the body, with matplotlib."""
        samples = yield from self._whole()
        return drawing.sphere(samples.gamma, ax)

    def _at(self, times: ArrayLike) -> Operation[Samples]:
        asked = evaluation.instants(times)
        function = yield from self._fetched()
        flat = asked.ravel()
        columns = evaluation.columns_at(function, flat)
        errors = evaluation.errors_at(function, flat)
        shaped = {name: each.reshape(asked.shape) for name, each in columns.items()}
        return Samples({"t": asked, **shaped}, {"t": 0.0, **{name: errors[name] for name in columns}})

    def _fetched(self) -> Operation[FunctionOfTime]:
        if self._function is None:
            document = yield from ask_json(self.carrier.terms, "GET", f"/v1/solutions/{self.id}/function")
            self._function = _read_function(document)
        return self._function

    def _stored(self) -> Operation[Samples]:
        path = f"/v1/solutions/{self.id}/trajectory"
        reply = yield from ask(self.carrier.terms, "GET", path, accept=ARROW)
        # It takes longer to load than all else that a command needs.
        import pyarrow as pa  # noqa: PLC0415

        table = pa.ipc.open_stream(reply.content).read_all()
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
        error = float(reply.headers[_ERROR_HEADER])
        return Samples(columns, {name: 0.0 if name == "t" else error for name in columns})

    def _whole(self) -> Operation[Samples]:
        """Return enough samples for a picture: of one period, or of all that was computed."""
        function = yield from self._fetched()
        times: FloatArray = np.linspace(function.breaks[0], function.breaks[-1], _PICTURE_POINTS)
        return (yield from self._at(times))

    def __repr__(self) -> str:
        return f"<motion {self.id}: period {self.period}, energy {self.energy}, error {self.error:.1e}>"

    def _repr_html_(self) -> str:
        picture = ""
        if isinstance(self.carrier, ThreadCarrier):
            try:
                picture = sphere_svg(self.carrier.run(partial(Motion._whole, self)()).gamma)
            except (PolhodeError, KeyError):
                picture = ""  # facts are better than nothing
        error = f"{self.error:.1e}"
        facts = {
            "period": self.period or self.aperiodic,
            "energy": self.energy,
            "claimed error": error,
            "problem": _in_words(self.problem),
            "method": f"{self.method}, {self.tier}",
            "id": self.id,
        }
        return table_html("Motion", facts, picture)


def _in_words(problem: Mapping[str, object]) -> str:
    """Return body, potential and motion of a problem on one line, without what is nested deeper."""
    parts = []
    for name in ("body", "potential", "motion"):
        section = problem.get(name)
        given = dict(section) if isinstance(section, Mapping) else {}
        parameters = given.pop("parameters", None)
        given |= parameters if isinstance(parameters, Mapping) else {}
        first = given.pop("expression", None) or given.get("type")
        given.pop("type", None)
        numbers = [f"{key} = {value}" for key, value in given.items() if isinstance(value, int | float | str)]
        parts.append(", ".join([str(first)] * (first is not None) + numbers))
    return "; ".join(parts)


def _read_function(document: Mapping[str, object]) -> FunctionOfTime:
    return FunctionOfTime(
        columns=tuple(map(str, items(document["columns"]))),
        breaks=np.array(document["breaks"], dtype=np.float64),
        coefficients=np.array(document["coefficients"], dtype=np.float64),
        period=None if document["period"] is None else _pair(document["period"]),
        error=float(str(document["error"])),
        errors={str(name): float(error) for name, error in fields(document["errors"]).items()},
        advances={str(name): _pair(gained) for name, gained in fields(document["advances"]).items()},
    )


def _pair(document: object) -> PairOfDoubles:
    return PairOfDoubles(*(float(fields(document)[name]) for name in ("hi", "lo", "error")))
