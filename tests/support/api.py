"""The application on a temporary database, and a solution whose values are a known function."""

import json
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import httpx
import numpy as np
import pytest
from fastapi import FastAPI

from service.app import create_app
from service.dynamics.solution.dense_output import (
    DenseOutput,
    Period,
    chebyshev_coefficients,
    chebyshev_points,
)
from service.jobs.records import Job, Solved
from service.sandbox import Sandbox
from service.settings import Settings
from service.storage.codecs.packing import encode_arrays, encode_dense
from service.storage.jobs.job_store import JobStore
from service.verdicts.starting import VerdictChildren
from tests.support.conformance import check_exchange
from tests.support.finishing import finish_success
from workers.computation.compute import solve_document

with warnings.catch_warnings():
    # Starlette would rather have httpx2; it works with httpx as well.
    warnings.simplefilter("ignore")
    from fastapi.testclient import TestClient as AnyTestClient


class TestClient(AnyTestClient):
    """A client on this machine; whatever it sends and gets must be as the OpenAPI document says."""

    __test__ = False

    def __init__(self, app: FastAPI, base_url: str = "http://127.0.0.1:8000", **options: object) -> None:
        super().__init__(app, base_url, **options)

    def send(self, request: httpx.Request, **options: object) -> httpx.Response:
        response = super().send(request, **options)
        check_exchange(request, response)
        return response


COLUMNS = ("p", "q", "r", "g1", "g2", "g3")
STATE = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "gravity", "a": 1, "c": "-1/2"},
    "motion": {"type": "state", "omega": ["2/5", "1/10", "9/10"], "gamma": ["3/5", 0, "4/5"]},
    "time": {"stop": 20, "samples": 201},
}
PLANAR = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {
        "type": "expression",
        "expression": "a*g1 + b/g3^2",
        "parameters": {"a": -1, "b": "1/20"},
    },
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 101},
}
PERIOD = 2.0
ERROR = 1e-13
SUMMARY = {
    "problem": STATE,
    "method": "quadrature",
    "tier": "standard",
    "period": {"value": PERIOD, "error": 1e-16},
    "aperiodic": None,
    "energy": {"value": 0.5, "error": 0.0},
    "window": {"index": 0, "ends": ["pole", "equator"], "g1": [0.0, 0.5], "g2": [0.0, 1.0]},
    "invariants": {"energy": {"drift": 2e-16}},
    "error": 3e-13,
    "cross_check": None,
    "stability": None,
    "conventions": ["symmetric_pole_passage"],
    "evidence": {"nodes": 64, "departure": 1e-15},
    "cost": {"compute_seconds": 0.004},
    "provenance": {
        "version": "0.1.0",
        "numerics": 1,
        "processor": "x86_64 X86_V3",
        "libraries": "numpy 2.0.0",
    },
}


def values_at(times: np.ndarray) -> np.ndarray:
    """The known function: cos and sin of the first three harmonics of the period."""
    phase = 2 * np.pi * np.asarray(times) / PERIOD
    return np.stack([f(k * phase) for k in (1, 2, 3) for f in (np.cos, np.sin)], axis=-1)


def dense_output() -> DenseOutput:
    breaks = np.linspace(0.0, PERIOD, 9)
    middle, half = (breaks[1:] + breaks[:-1]) / 2, np.diff(breaks) / 2
    pieces = [
        chebyshev_coefficients(values_at(m + h * chebyshev_points(20)))
        for m, h in zip(middle, half, strict=True)
    ]
    return DenseOutput(COLUMNS, breaks, np.array(pieces), Period(PERIOD, 0.0, 1e-16), ERROR)


STORED_TIMES = np.linspace(0.0, 10.0, 11)


@dataclass(frozen=True)
class Stored:
    job: Job
    solution_id: str


def finish(jobs: JobStore, *, summary: dict = SUMMARY, spoil: bool = False) -> Stored:
    """Do a worker's work for the oldest job, with the known function for a solution."""
    claim = jobs.claim("test", lease_seconds=60.0)
    assert claim is not None
    samples = values_at(STORED_TIMES)
    if spoil:
        samples[3, 0] = np.nan
    columns = {"t": STORED_TIMES, **{name: samples[:, k] for k, name in enumerate(COLUMNS)}}
    assert finish_success(
        jobs, claim, summary, dense=encode_dense(dense_output()), samples=encode_arrays(columns)
    )
    job = jobs.get(claim.job_id)
    assert job.solution_id is not None
    return Stored(job, job.solution_id)


@pytest.fixture(scope="session")
def verdicts() -> Iterator[Sandbox]:
    """Children shared by the applications of all tests; starting them takes longer than most tests."""
    sandbox = VerdictChildren(Settings()).ready()
    yield sandbox
    sandbox.close()


@pytest.fixture
def app(url: str, verdicts: Sandbox) -> FastAPI:
    return create_app(Settings(database_url=url, verdict_seconds=60.0), sandbox=verdicts)


@pytest.fixture
def client(app: FastAPI) -> Iterator[TestClient]:
    with TestClient(app, raise_server_exceptions=False) as client:
        yield client


@pytest.fixture
def stored(client: TestClient, jobs: JobStore) -> Stored:
    assert client.post("/v1/jobs", json=STATE).status_code == 202
    return finish(jobs)


def solve_job(client, jobs, problem):
    """Submit, solve and store as a worker does, and return the solution."""
    assert client.post("/v1/jobs", json=problem).status_code == 202
    claim = jobs.claim("test", lease_seconds=60.0)
    outcome = solve_document(json.dumps(claim.problem))
    assert isinstance(outcome, Solved), outcome
    assert finish_success(jobs, claim, outcome.summary, dense=outcome.dense, samples=outcome.samples)
    solution_id = client.get(f"/v1/jobs/{claim.job_id}").json()["solution"]
    response = client.get(f"/v1/solutions/{solution_id}")
    assert response.status_code == 200, response.json()
    return response.json()


NEEDED_QUERY = {
    "/v1/jobs/facets": "?by=state",
    "/v1/jobs/statistics": "?of=attempt",
    "/v1/solutions/facets": "?by=tier",
    "/v1/solutions/statistics": "?of=period",
    "/v1/sweeps/{sweep_id}/grid": "?of=period",
    "/v1/sweeps/{sweep_id}/points/facets": "?by=outcome",
    "/v1/sweeps/{sweep_id}/points/statistics": "?of=period",
}
"""Queries of the routes that need one."""


def ask_again(client, path, answer, **headers):
    """Send the tag of an answer along, as caches do."""
    return client.get(path, headers={"If-None-Match": answer.headers["etag"], **headers})
