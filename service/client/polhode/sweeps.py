"""Sweeps: one problem, some of whose numbers vary along axes."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Generic, SupportsIndex, overload
from urllib.parse import urlencode

import numpy as np

from polhode import drawing
from polhode.documents.problems import Document, changed, nearest
from polhode.documents.quantities import fields, items, whole
from polhode.drawing import table_html
from polhode.errors import WrongArgumentError
from polhode.evaluation import FloatArray, optional
from polhode.jobs import WAIT_SECONDS, motion_of, submit
from polhode.motions import Motion
from polhode.transport.carriers import CarrierT
from polhode.transport.exchange import ARROW, FINAL, ask, ask_json, follow
from polhode.transport.terms import Operation, operation

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    import xarray as xr
    from matplotlib.axes import Axes


class Sweep(Generic[CarrierT]):
    """A sweep at the service; ``sweep[17]`` is a point of it.

    Attributes
    ----------
    state
        The sweep as the service described it last, with ``state``, ``points``, ``done`` and ``refused``.
    """

    def __init__(self, carrier: CarrierT, document: Document) -> None:
        self.carrier, self.state = carrier, document

    @property
    def id(self) -> str:
        """Id of the sweep."""
        return str(self.state["id"])

    @property
    def done(self) -> int:
        """Points that were computed, when last asked."""
        return int(str(self.state["done"]))

    @property
    def refused(self) -> int:
        """Points without a motion, when last asked; ``outcome`` in the frame tells why."""
        return int(str(self.state["refused"]))

    def __len__(self) -> int:
        return int(str(self.state["points"]))

    @overload
    def __getitem__(self, index: SupportsIndex) -> "Point[CarrierT]": ...
    @overload
    def __getitem__(self, index: slice) -> "list[Point[CarrierT]]": ...
    def __getitem__(self, index: SupportsIndex | slice) -> "Point[CarrierT] | list[Point[CarrierT]]":
        """Return a point, or the points of a slice."""
        if isinstance(index, slice):
            return [Point(self, each) for each in range(len(self))[index]]
        place = whole(index, "index")
        if not -len(self) <= place < len(self):
            raise IndexError(f"point {place} of {len(self)}")
        return Point(self, place % len(self))

    @operation
    def wait(self, *, seconds: float | None = None) -> Operation[None]:
        """Return once all points are computed.

        Raises
        ------
        UnfinishedError
            It took longer than ``seconds``; the sweep goes on.
        """
        known = self.state if self.state.get("state") in FINAL else None
        state = yield from follow(
            self.carrier.terms, f"/v1/sweeps/{self.id}", known, seconds=seconds, what="points"
        )
        self.state = {**self.state, **state}

    @operation
    def cancel(self) -> Operation[None]:
        """Compute no more points; those that are computed stay."""
        self.state |= yield from ask_json(self.carrier.terms, "POST", f"/v1/sweeps/{self.id}/cancel")

    @operation
    def table(self, where: str | None = None, *, order: str | None = None) -> Operation["pa.Table"]:
        """Return the computed points as an Arrow table, with the names of the service."""
        return (yield from self._points(where, order))

    @operation
    def frame(self, where: str | None = None, *, order: str | None = None) -> Operation["pd.DataFrame"]:
        """Return the computed points as a pandas frame.

        Axes have short names, such as ``lambda`` for ``/motion/lambda``, where these are unique.
        """
        optional("pandas", "frame()")
        table = yield from self._points(where, order)
        short = yield from self._names()
        return table.rename_columns([short.get(name, name) for name in table.column_names]).to_pandas()

    @operation
    def values(self, name: str) -> Operation[FloatArray]:
        """Return a kept number as an array with an axis for each axis of a grid; NaN where there is none."""
        return (yield from self._grid(name))[0]

    @operation
    def array(self) -> Operation["xr.Dataset"]:
        """Return all kept numbers as an xarray dataset, with the axes of the grid as its coordinates."""
        xarray = optional("xarray", "array()")
        document = yield from self._document()
        short = list((yield from self._names()).values())
        found = {}
        for name in items(document["keep"]):
            found[name] = yield from self._grid(name)
        values, coordinates = next(iter(found.values()))
        dims = short if values.ndim == len(short) else ["index"]
        coords = {
            name: (dims[0] if len(dims) == 1 else name, each)
            for name, each in zip(short, coordinates, strict=True)
        }
        dataset: xr.Dataset = xarray.Dataset(
            {name: (dims, values) for name, (values, _) in found.items()}, coords=coords
        )
        return dataset

    @operation
    def heatmap(self, name: str, *, ax: "Axes | None" = None) -> Operation["Axes"]:
        """Draw a kept number over the two axes of a grid, with matplotlib.

        Raises
        ------
        WrongArgumentError
            The sweep has another number of axes.
        """
        values, coordinates = yield from self._grid(name)
        names = list((yield from self._names()).values())
        if values.ndim != 2:
            raise WrongArgumentError(f"heatmap() needs a grid of two axes; this sweep has {', '.join(names)}")
        return drawing.heatmap(values, coordinates, names, name, ax)

    @operation
    def package(self, file: str | os.PathLike[str]) -> Operation[Path]:
        """Write the finished sweep as a data package (Frictionless), to publish it, and return its path.

        It is a ZIP of the points as Parquet, the document that computes them again, and a descriptor with
        columns, units, errors, provenance and checksums.

        Raises
        ------
        RefusedError
            The sweep has not ended.
        """
        reply = yield from ask(self.carrier.terms, "GET", f"/v1/sweeps/{self.id}/package", accept="*/*")
        path = Path(file)
        path.write_bytes(reply.content)
        return path

    def _points(self, where: str | None, order: str | None) -> Operation["pa.Table"]:
        query = urlencode([pair for pair in (("where", where), ("order", order)) if pair[1]])
        path = f"/v1/sweeps/{self.id}/points" + (f"?{query}" if query else "")
        reply = yield from ask(self.carrier.terms, "GET", path, accept=ARROW)
        # It takes longer to load than all else that a command needs.
        import pyarrow as pa  # noqa: PLC0415

        return pa.ipc.open_stream(reply.content).read_all()

    def _document(self) -> Operation[Document]:
        if "document" not in self.state:
            self.state |= yield from ask_json(self.carrier.terms, "GET", f"/v1/sweeps/{self.id}")
        return fields(self.state["document"])

    def _axes(self) -> Operation[list[Mapping[str, object]]]:
        document = yield from self._document()
        return items(document["axes"])

    def _names(self) -> Operation[dict[str, str]]:
        """Return the short name of each axis by its pointer."""
        axes = yield from self._axes()
        pointers = [str(axis["pointer"]) for axis in axes]
        last = [pointer.rpartition("/")[2] for pointer in pointers]
        taken = {"index", "outcome"}
        return {
            pointer: name if last.count(name) == 1 and name not in taken and not name.isdigit() else pointer
            for pointer, name in zip(pointers, last, strict=True)
        }

    def _grid(self, name: str) -> Operation[tuple[FloatArray, list[FloatArray]]]:
        """Return a number in the shape of the grid, and the values of the axes."""
        document = yield from self._document()
        table = yield from self._points(None, None)
        if name not in table.column_names:
            known = [each for each in table.column_names if each not in ("index", "outcome")]
            raise WrongArgumentError(
                f"{name!r} was not kept{nearest(name, known)}; there are {', '.join(known)}"
            )
        index = table.column("index").to_numpy()
        is_zip = document.get("combine") == "zip"
        axes = yield from self._axes()
        shape = (len(self),) if is_zip else tuple(map(_length, axes))

        def spread(column: str) -> FloatArray:
            values: FloatArray = np.full(len(self), np.nan)
            values[index] = table.column(column).to_numpy()
            return values.reshape(shape)

        coordinates = []
        for k, axis in enumerate(axes):
            whole = spread(str(axis["pointer"]))
            others = tuple(j for j in range(whole.ndim) if j != k and not is_zip)
            # Along the other axes they are all the same; those that are missing are NaN.
            coordinates.append(whole if is_zip else np.fmax.reduce(whole, axis=others) if others else whole)
        return spread(name), coordinates

    def __repr__(self) -> str:
        return f"<sweep {self.id}: {self.done} of {len(self)} points, {self.refused} without a motion>"

    def _repr_html_(self) -> str:
        facts = {name: self.state.get(name) for name in ("state", "points", "done", "refused", "id")}
        return table_html("Sweep", facts)


class Point(Generic[CarrierT]):
    """A point of a sweep."""

    def __init__(self, sweep: Sweep[CarrierT], index: int) -> None:
        self.sweep, self.index = sweep, index
        self.carrier = sweep.carrier

    @operation
    def row(self) -> Operation[dict[str, object]]:
        """Return its index, the numbers of its axes, the kept numbers and its outcome."""
        return (yield from self._row())

    @operation
    def problem(self) -> Operation[Document]:
        """Return the document of this point alone."""
        return (yield from self._problem())

    @operation
    def motion(self) -> Operation[Motion[CarrierT]]:
        """Solve the point's problem alone, and return its motion."""
        document = yield from self._problem()
        terms = self.carrier.terms
        job = yield from submit(terms, document, seconds=WAIT_SECONDS)
        job = yield from follow(terms, f"/v1/jobs/{job['id']}", job)
        return (yield from motion_of(self.carrier, job))

    def _row(self) -> Operation[dict[str, object]]:
        path = f"/v1/sweeps/{self.sweep.id}/points?where=index={self.index}&limit=1"
        page = yield from ask_json(self.carrier.terms, "GET", path)
        rows = items(page["items"])
        if not rows:
            raise WrongArgumentError(f"point {self.index} is not computed yet; wait() waits for all of them")
        return fields(rows[0])

    def _problem(self) -> Operation[Document]:
        document = yield from Sweep._document(self.sweep)
        axes = yield from Sweep._axes(self.sweep)
        row = yield from self._row()
        lengths = [_length(axis) for axis in axes]
        is_zip = document.get("combine") == "zip"
        indices = [self.index] * len(axes) if is_zip else _grid_indices(self.index, lengths)
        numbers: dict[str, object] = {}
        for axis, index in zip(axes, indices, strict=True):
            pointer, listed = str(axis["pointer"]), axis.get("values")
            # Listed values are exact; the others mean the shortest decimal of the number shown.
            numbers[pointer] = listed[index] if isinstance(listed, list) else row[pointer]
        return changed(fields(document["base"]), numbers)

    def __repr__(self) -> str:
        return f"<point {self.index} of sweep {self.sweep.id}>"


def _length(axis: Mapping[str, object]) -> int:
    for name in ("values", "linspace", "logspace", "uniform"):
        section = axis.get(name)
        if isinstance(section, list):
            return len(section) if name == "values" else int(section[2])
    raise WrongArgumentError(f"the axis {axis} has no values")


def _grid_indices(index: int, lengths: Sequence[int]) -> list[int]:
    """Return the index of a point on each axis of a grid, whose last axis varies fastest."""
    indices = []
    for length in reversed(lengths):
        index, on_axis = divmod(index, length)
        indices.append(on_axis)
    return indices[::-1]
