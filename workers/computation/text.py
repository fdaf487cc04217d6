"""Writes a solution as text for people, and its samples as CSV."""

from collections.abc import Iterator, Mapping
from typing import Any  # JSON values of a summary: their shapes are those of the solution resource

import numpy as np
from numpy.typing import NDArray

from service.csv_text import LF, data_lines, header_line
from service.dynamics.motion import NO_CROSS_CHECK
from service.dynamics.solution.ball_columns import is_part

FloatArray = NDArray[np.float64]
Summary = Mapping[str, Any]

ROWS_SHOWN = 6


def describe(summary: Summary, columns: Mapping[str, FloatArray]) -> str:
    """Return the solution with its error bounds in a few lines."""
    if not columns:
        return "\n".join(_numbers(summary))
    shown = {name: values for name, values in columns.items() if not is_part(name)}
    return "\n".join([*_numbers(summary), "", *_table(shown)])


def to_csv(columns: Mapping[str, FloatArray]) -> str:
    """Return the samples as CSV, every double in the shortest form that reads back to it."""
    return header_line(columns, LF) + data_lines(columns.values(), LF)


def _numbers(summary: Summary) -> Iterator[str]:
    yield f"method      {summary['method']}"
    period = summary["period"]
    if period is not None:
        yield f"period      {_number(period)}"
    if summary["aperiodic"] is not None:
        yield f"aperiodic   {summary['aperiodic']}"
        for when, end in summary["asymptotes"].items():
            yield f"{when:<12}{_asymptote(end)}"
    energy = summary["energy"]
    yield f"energy      {_number(energy)}"
    window = summary["window"]
    if window is not None:
        (lower, upper), (first, last) = window["ends"], window["g1"]
        yield f"window      {lower} to {upper}, g1 from {first:.12g} to {last:.12g}"
    yield f"error       ≤ {summary['error']:.1e} in every variable at the sampled times"
    groups = {name: error["relative"] for name, error in summary["errors"].items()}
    if groups:
        told = (f"{name} {error:.1e}" for name, error in groups.items() if error is not None)
        yield f"relative    ≤ {', '.join(told)}"
    for name, integral in (summary["invariants"] or {}).items():
        value = f" of {integral['value']!r} ({integral['kind']})" if "value" in integral else ""
        yield f"{name + ' drift':<18}{integral['drift']:.1e}{value}"
    stability = summary["stability"]
    if stability is not None:
        yield f"stability   {stability['verdict']}, trace {stability['trace']!r} ± {stability['error']:.1e}"
    for name, angle in (summary["precession"] or {}).items():
        yield f"precession  {name} {angle['value']!r} ± {angle['error']:.1e} a period"
    check, warnings = summary["cross_check"], summary["warnings"]
    if check is not None and not any(warning["code"] == NO_CROSS_CHECK for warning in warnings):
        verdict = "agrees" if check["agrees"] else "DISAGREES"
        extent = f"within {check['disagreement']:.1e} up to t = {check['horizon']:.6g}"
        yield f"cross-check {verdict} with {check['method']} {extent}"
    for convention in summary["conventions"]:
        yield f"convention  {convention}"
    for warning in warnings:
        yield f"warning     {warning['message']} ({warning['code']})"


def _number(estimate: Mapping[str, Any]) -> str:
    if "radius" in estimate:
        return f"{estimate['value']} ± {estimate['radius']} (proven)"
    return f"{estimate['value']!r} ± {estimate['error']:.1e}"


def _asymptote(end: Mapping[str, Any]) -> str:
    where = "{} at g = ({:.12g}, {:.12g}, {:.12g})".format(end["kind"], *end["gamma"])
    if end["time"] is not None:
        return f"{where}, t = {end['time']['value']!r} ± {end['time']['error']:.1e}"
    if end["rate"] is not None:
        return f"{where}, approached like exp(-{end['rate']['value']:.12g} |t|)"
    return where


def _table(columns: Mapping[str, FloatArray]) -> Iterator[str]:
    names = list(columns)
    yield "".join(f"{name:>16}" for name in names)
    length = len(columns["t"])
    chosen = sorted({round(k * (length - 1) / max(ROWS_SHOWN - 1, 1)) for k in range(ROWS_SHOWN)})
    for row in chosen:
        yield "".join(f"{columns[name][row]:16.10f}" for name in names)
    if length > len(chosen):
        yield f"({len(chosen)} of {length} samples)"
