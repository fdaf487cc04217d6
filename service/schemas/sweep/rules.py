"""Checks the rules between the parts of a sweep document."""

import math
from collections.abc import Iterator, Mapping, Sequence

from service.dynamics.errors import InvalidNumberError
from service.dynamics.exact import exact_number
from service.dynamics.problem import Problem
from service.schemas.reading.faults import Fault
from service.schemas.reading.pointers import NoSuchPlaceError, split_pointer, value_at
from service.schemas.sweep.axes import AxisModel
from service.schemas.sweep.kept_numbers import NUMBERS
from service.schemas.sweep.sweep import Sweep

MAX_SERIES_SAMPLES = 100_000_000
"""Samples of all points together: 0.8 GB of every column before compression."""

_SAMPLES = ("time", "samples")

Placed = Sequence[tuple[int, AxisModel]]
"""The axes that could be read, each with its place in the list."""


def pointer_faults(pointers: Mapping[int, str], base: Mapping[str, object]) -> Iterator[Fault]:
    """Yield the faults of the axes' pointers into the base."""
    first_use: dict[str, int] = {}
    for place, pointer in pointers.items():
        where = f"/axes/{place}/pointer"
        try:
            found = value_at(base, split_pointer(pointer))
        except NoSuchPlaceError as error:
            message = f"{error}; accepted is a pointer to a number that the base has"
            yield Fault(where, "unknown_pointer", message)
            continue
        if not _is_number(found):
            message = f"the base has no number at {pointer}; accepted is a pointer to one that it has"
            yield Fault(where, "not_a_number", message)
        elif pointer in first_use:
            message = f"/axes/{first_use[pointer]} has this pointer too; each number varies along one axis"
            yield Fault(where, "pointer_taken", message)
        first_use.setdefault(pointer, place)


def length_faults(axes: Placed, combine: object, max_points: int | None) -> Iterator[Fault]:
    """Yield the faults of the numbers of values."""
    lengths = [axis.to_domain(place).length for place, axis in axes]
    if combine == "zip":
        for (place, _), length in zip(axes, lengths, strict=True):
            if length != lengths[0]:
                message = f"{length} values, and /axes/{axes[0][0]} has {lengths[0]}; zip needs equally many"
                yield Fault(f"/axes/{place}", "unequal_lengths", message)
    points = max(lengths, default=0) if combine == "zip" else math.prod(lengths)
    if max_points is not None and points > max_points:
        yield Fault("/axes", "too_many_points", f"{points} points; at most {max_points} are accepted")


def budget_faults(base: Mapping[str, object]) -> Iterator[Fault]:
    """Yield a fault for a budget, which is turned into a tier for one problem at a time."""
    match base:
        case {"accuracy": {"budget_seconds": _}}:
            message = "a budget is for single problems; accepted in a sweep are a tolerance and a tier"
            yield Fault("/base/accuracy/budget_seconds", "budget_in_sweep", message)


def kept_faults(keep: Sequence[str], problem: Problem, *, has_series: bool) -> Iterator[Fault]:
    """Yield the faults of ``keep`` for points like ``problem``."""
    if not keep and not has_series:
        accepted = ", ".join(NUMBERS)
        yield Fault("/keep", "invalid_length", f"nothing is kept of the points; accepted are {accepted}")
    for place, name in enumerate(keep):
        output = NUMBERS[name].output
        if name in keep[:place]:
            yield Fault(f"/keep/{place}", "invalid_value", f"{name} is given twice; once is accepted")
        elif output is not None and output not in problem.outputs:
            message = f'{name} needs "{output}" among the outputs of the base'
            yield Fault(f"/keep/{place}", "output_needed", message)


def series_faults(sweep: Sweep) -> Iterator[Fault]:
    """Yield the faults of keeping the samples of every point of ``sweep``."""
    if not sweep.series_columns:
        message = "the outputs of the base hold no function of time; add gamma, omega or orientation"
        yield Fault("/series", "output_needed", message)
    for place, each in enumerate(sweep.axes):
        if each.path == _SAMPLES:
            message = "series are equally long: with them the number of samples cannot vary"
            yield Fault(f"/axes/{place}/pointer", "varying_samples", message)
    total = sweep.points * sweep.samples
    if total > MAX_SERIES_SAMPLES:
        message = (
            f"{sweep.points} points with {sweep.samples} samples are {total} samples; at most "
            f"{MAX_SERIES_SAMPLES} are accepted. Without series any point can be solved again by itself"
        )
        yield Fault("/series", "series_too_large", message)


def _is_number(found: object) -> bool:
    if isinstance(found, bool) or not isinstance(found, int | float | str):
        return False
    try:
        exact_number(found)
    except InvalidNumberError:
        return False
    return True
