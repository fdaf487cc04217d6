"""Writes the solution document that a client reads, without ids and arrays."""

from dataclasses import asdict

import numpy as np
from flint import arb

from service.dynamics.formula.printer import format_tree
from service.dynamics.motion import CrossCheck, Estimate, Motion
from service.dynamics.numerics import NUMERICS
from service.dynamics.problem import Problem
from service.dynamics.solution.ball_columns import as_decimals
from service.dynamics.verdict.simple_form import SIMPLER_POTENTIAL, is_simplified
from service.storage.codecs.summary import FIRST_PASSAGE, PROVEN_SAMPLES
from service.versions import version_of
from workers.computation.outputs import Findings
from workers.computation.processor import libraries, processor, threads
from workers.solvers.certified.certify import Certified
from workers.solvers.orientation.advance import Precession
from workers.solvers.stability.assessment import Stability
from workers.solvers.ways import current_way

Document = dict[str, object]


def summarise(
    document: Document, problem: Problem, motion: Motion, findings: Findings, certified: Certified | None
) -> Document:
    """Return the solution resource of the problem ``document`` without its ids and cost."""
    window, orientation = motion.window, findings.orientation
    precession = None if orientation is None else orientation.precession
    return {
        "problem": document,
        "method": motion.method,
        "tier": problem.accuracy.tier,
        "period": _period(motion) if certified is None else _enclosure(certified.period),
        "aperiodic": motion.aperiodic,
        "asymptotes": None
        if motion.past is None or motion.future is None
        else {"past": asdict(motion.past), "future": asdict(motion.future)},
        "energy": _estimate(motion.energy) if certified is None else _enclosure(certified.energy),
        "window": None
        if window is None
        else {"index": window.index, "ends": window.ends, "g1": window.g1, "g2": window.g2},
        "invariants": _invariants(findings),
        "error": motion.error,
        "cross_check": None if motion.cross_check is None else _cross_check(motion.cross_check),
        "stability": None
        if findings.stability is None
        else _stability(findings.stability, findings.closed_trace),
        "precession": None if precession is None else _precession(precession),
        "conventions": motion.conventions,
        "warnings": [asdict(notice) for notice in findings.notices],
        "evidence": _evidence(problem, motion),
        "provenance": provenance(),
    }


def _cross_check(check: CrossCheck) -> Document:
    """Return what was compared; why nothing was is among the warnings."""
    return {name: value for name, value in asdict(check).items() if name != "why_none"}


def provenance() -> Document:
    """Return what computes here. What is equal in all of it gives equal problems the same bits."""
    return {
        "version": version_of("polhode"),
        "numerics": NUMERICS,
        "processor": processor(),
        "libraries": libraries(),
        "threads": threads(),
        "way": current_way(),
    }


def _evidence(problem: Problem, motion: Motion) -> Document:
    """Return what the solvers measured, and what the motion says of itself beside its error."""
    potential = problem.potential
    simpler = format_tree(potential.tree) if is_simplified(potential) else None
    said = {
        FIRST_PASSAGE: motion.first_passage,
        PROVEN_SAMPLES: motion.enclosed_by,
        SIMPLER_POTENTIAL: simpler,
    }
    return {**motion.evidence, **{name: value for name, value in said.items() if value is not None}}


def _period(motion: Motion) -> Document | None:
    period = motion.dense.period
    if period is None:
        return None
    return {"value": period.hi, "error": float(np.nextafter(abs(period.lo) + period.error, np.inf))}


def _estimate(number: Estimate) -> Document:
    return {"value": number.value, "error": number.error}


def _enclosure(ball: arb) -> Document:
    value, radius = as_decimals(ball)
    return {"value": value, "radius": radius}


def _invariants(findings: Findings) -> Document | None:
    if findings.drifts is None:
        return None
    drifts: Document = {name: {"drift": drift} for name, drift in asdict(findings.drifts).items()}
    for found in findings.further:
        kind = found.integral.kind
        drifts[found.integral.name] = {"value": found.value, "drift": found.drift, "kind": kind}
    drifts |= {f"relation: {name}": {"drift": drift} for name, drift in findings.relations.items()}
    return drifts


def _precession(precession: Precession) -> Document:
    return {"psi1": asdict(precession.psi1), "psi3": asdict(precession.psi3)}


def _stability(stability: Stability, closed_trace: Estimate | None) -> Document:
    pairs = [[multiplier.real, multiplier.imag] for multiplier in stability.multipliers]
    closed = None if closed_trace is None else asdict(closed_trace)
    return {**asdict(stability), "multipliers": pairs, "closed_form_trace": closed}
