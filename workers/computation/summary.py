"""Writes the solution document that a client reads, without ids and arrays."""

from collections.abc import Mapping
from dataclasses import asdict
from math import isfinite

import numpy as np
from flint import arb

from service.dynamics.accuracy import GroupError
from service.dynamics.discovery.known import known_cases
from service.dynamics.equations.orientation import LOCAL_QUATERNION
from service.dynamics.formula.tree import format_tree
from service.dynamics.motion import Asymptote, CrossCheck, Estimate, Motion
from service.dynamics.numerics import NUMERICS, ErrorKind, printed_error
from service.dynamics.potentials.potential import Notice
from service.dynamics.problem import Problem
from service.dynamics.solution.dense_output import as_decimals
from service.dynamics.verdict.simple_form import SIMPLER_POTENTIAL, is_simplified
from service.schemas.reading.documents import Part
from service.schemas.replies.summary import (
    AsymptoteSummary,
    CrossCheckSummary,
    EnclosureSummary,
    EstimateSummary,
    GroupErrorSummary,
    IntegralSummary,
    NoticeSummary,
    PrecessionSummary,
    ProvenanceSummary,
    SolutionSummary,
    StabilitySummary,
)
from service.storage.codecs.summary import FIRST_PASSAGE, PROVEN_SAMPLES
from service.versions import version_of
from workers.computation.compiled_code import libraries, processor, threads
from workers.computation.outputs import Outputs
from workers.solvers.certified.certify import Certified
from workers.solvers.orientation.advance import Precession
from workers.solvers.stability.assessment import Stability
from workers.solvers.ways import current_way


def summarise(
    document: Part,
    problem: Problem,
    motion: Motion,
    outputs: Outputs,
    certified: Certified | None,
    errors: Mapping[str, GroupError],
) -> SolutionSummary:
    """Return the solution resource of the problem ``document`` without its ids and cost."""
    window, orientation = motion.window, outputs.orientation
    precession = None if orientation is None else orientation.precession
    invariants, beyond = _invariants(outputs, certified)
    known = known_cases(problem.body, problem.potential)
    return {
        "problem": document,
        "method": motion.method,
        "tier": problem.accuracy.tier,
        "period": _period(motion)
        if certified is None or certified.period is None
        else _enclosure(certified.period),
        "aperiodic": motion.aperiodic,
        "asymptotes": None
        if motion.past is None or motion.future is None
        else {"past": _limit(motion.past), "future": _limit(motion.future)},
        "energy": _estimate(motion.energy) if certified is None else _enclosure(certified.energy),
        "window": None
        if window is None
        else {"index": window.index, "ends": window.ends, "g1": window.g1, "g2": window.g2},
        "invariants": invariants,
        "error": motion.error,
        "errors": {name: _group(error) for name, error in errors.items()},
        "error_kind": error_kinds(motion, outputs, certified),
        "cross_check": None if motion.cross_check is None else _cross_check(motion.cross_check),
        "stability": None
        if outputs.stability is None
        else _stability(outputs.stability, outputs.closed_trace),
        "precession": None if precession is None else _precession(outputs, precession),
        "conventions": motion.conventions,
        "known_cases": [{"name": each.name, "source": each.source} for each in known],
        "warnings": [_notice(notice) for notice in (*outputs.notices, *beyond)],
        "evidence": _evidence(problem, motion),
        "provenance": provenance(),
    }


def has_proven_attitude(certified: Certified | None) -> bool:
    """Tell whether the enclosures have the attitude."""
    return certified is not None and LOCAL_QUATERNION[0] in certified.columns


def error_kinds(motion: Motion, outputs: Outputs, certified: Certified | None) -> dict[str, ErrorKind]:
    """Return how each error of a solution is known, by the path of the number that it belongs to.

    ``samples`` are those of the six variables that were asked for, ``function`` is the function of time that
    any others come from.
    """
    kinds: dict[str, ErrorKind] = {"energy": motion.energy.kind if certified is None else "theorem"}
    if motion.dense.period is not None:
        is_proven = certified is not None and certified.period is not None
        kinds["period"] = "theorem" if is_proven else motion.dense.period.kind
    if len(motion.times):
        # That with an attitude is cut into other pieces.
        function = motion.function_kind if outputs.orientation is None else outputs.orientation.kind
        kinds |= {"samples": motion.samples_kind, "function": function}
    for name, limit in (("past", motion.past), ("future", motion.future)):
        numbers = {} if limit is None else {"time": limit.time, "rate": limit.rate}
        kinds |= {f"asymptotes.{name}.{key}": each.kind for key, each in numbers.items() if each is not None}
    if outputs.orientation is not None:
        kinds["orientation"] = "theorem" if has_proven_attitude(certified) else outputs.orientation.kind
        if (precession := outputs.orientation.precession) is not None:
            proven = outputs.precession is not None
            for name, angle in (("psi1", precession.psi1), ("psi3", precession.psi3)):
                kinds[f"precession.{name}"] = "theorem" if proven else angle.kind
    if outputs.stability is not None:
        kinds["stability"] = outputs.stability.proof
        kinds["stability.trusted_time"] = outputs.stability.trusted_time_proof
        if outputs.stability.enclosed is not None:
            kinds["stability.trace"] = "theorem"
    if outputs.drifts is not None and certified is not None:
        kinds |= {f"invariants.{name}.value": "theorem" for name in asdict(outputs.drifts)}
    if outputs.closed_trace is not None:
        kinds["stability.closed_form_trace"] = outputs.closed_trace.kind
    return kinds


def _notice(notice: Notice) -> NoticeSummary:
    return {"code": notice.code, "message": notice.message, "pointer": notice.pointer}


def _group(error: GroupError) -> GroupErrorSummary:
    """Return an error; variables that are all 0, and are not known to be, have no relative one."""
    relative = error.relative
    return {"absolute": error.absolute, "relative": relative if isfinite(relative) else None}


def _cross_check(check: CrossCheck) -> CrossCheckSummary:
    """Return what was compared; why nothing was is among the warnings."""
    return {
        "method": check.method,
        "disagreement": check.disagreement,
        "horizon": check.horizon,
        "agrees": check.agrees,
    }


def provenance() -> ProvenanceSummary:
    """Return what computes here. What is equal in all of it gives equal problems the same bits."""
    return {
        "version": version_of("polhode"),
        "numerics": NUMERICS,
        "processor": processor(),
        "libraries": libraries(),
        "threads": threads(),
        "way": current_way(),
    }


def _evidence(problem: Problem, motion: Motion) -> Mapping[str, float | int | str]:
    """Return what the solvers measured, and what the motion says of itself beside its error."""
    potential = problem.potential
    simpler = format_tree(potential.tree) if is_simplified(potential) else None
    said = {
        FIRST_PASSAGE: motion.first_passage,
        PROVEN_SAMPLES: motion.enclosed_by,
        SIMPLER_POTENTIAL: simpler,
    }
    return {**motion.evidence, **{name: value for name, value in said.items() if value is not None}}


def _period(motion: Motion) -> EstimateSummary | None:
    period = motion.dense.period
    if period is None:
        return None
    error = float(np.nextafter(abs(period.lo) + period.error, np.inf))
    return _estimate(Estimate(period.hi, error, period.kind))


def _estimate(number: Estimate) -> EstimateSummary:
    """Return a number with the bound of the error of the decimal that it is written as."""
    return {"value": number.value, "error": printed_error(number.value, number.error)}


def _limit(limit: Asymptote) -> AsymptoteSummary:
    time, rate = (None if number is None else _estimate(number) for number in (limit.time, limit.rate))
    return {"kind": limit.kind, "time": time, "rate": rate, "gamma": limit.gamma}


def _enclosure(ball: arb) -> EnclosureSummary:
    value, radius = as_decimals(ball)
    return {"value": value, "radius": radius}


def _invariants(
    outputs: Outputs, certified: Certified | None
) -> tuple[Mapping[str, IntegralSummary] | None, list[Notice]]:
    """Return the integrals, and a warning that tells those whose numbers are beyond doubles."""
    if outputs.drifts is None:
        return None, []
    integrals: dict[str, IntegralSummary] = {
        name: {"drift": drift} for name, drift in asdict(outputs.drifts).items()
    }
    if certified is not None:
        for name, ball in zip(
            integrals, (certified.energy, certified.geometric, certified.areas), strict=True
        ):
            integrals[name]["value"] = _enclosure(ball)
    for each in outputs.further:
        kind = each.integral.kind
        integrals[each.integral.name] = {"value": each.value, "drift": each.drift, "kind": kind}
    integrals |= {f"relation: {name}": {"drift": drift} for name, drift in outputs.relations.items()}
    beyond = [name for name, numbers in integrals.items() if not _are_finite(numbers)]
    finite = {name: numbers for name, numbers in integrals.items() if name not in beyond}
    text = f"left out, since doubles do not reach so far: {', '.join(beyond)}"
    return finite, [Notice("invariants_not_finite", text, "/outputs")] if beyond else []


def _are_finite(numbers: IntegralSummary) -> bool:
    return all(isfinite(number) for number in numbers.values() if isinstance(number, float))


def _precession(outputs: Outputs, precession: Precession) -> PrecessionSummary:
    if outputs.precession is not None:
        one, three = outputs.precession
        return {"psi1": _enclosure(one), "psi3": _enclosure(three)}
    return {"psi1": _estimate(precession.psi1), "psi3": _estimate(precession.psi3)}


def _stability(stability: Stability, closed_trace: Estimate | None) -> StabilitySummary:
    return {
        "trace": stability.trace if stability.enclosed is None else _enclosure(stability.enclosed),
        "error": printed_error(stability.trace, stability.error),
        "multipliers": [[multiplier.real, multiplier.imag] for multiplier in stability.multipliers],
        "multipliers_error": stability.multipliers_error,
        "verdict": stability.verdict,
        "proof": stability.proof,
        "exponent": stability.exponent,
        "exponent_error": printed_error(stability.exponent, stability.exponent_error),
        "trusted_time": stability.trusted_time,
        "closed_form_trace": None if closed_trace is None else _estimate(closed_trace),
    }
