"""Facets and statistics of jobs, solutions and points: how often values occur, and how numbers are spread."""

from collections.abc import Iterable
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response

from service.api.dependencies import Inside
from service.api.middleware.heavy_answers import heavy
from service.api.queries.lists import FacetsQuery, StatisticsQuery, estimate_of, read_facets, read_statistics
from service.api.queries.points import vocabulary_of
from service.api.queries.queries import Asked, asked_of, query_parameters
from service.api.replies import SweepId, json_response, refusals
from service.schemas.replies.sweep import (
    FacetOut,
    FacetsOut,
    FacetValueOut,
    HistogramOut,
    QueryEstimateOut,
    StatisticOut,
    StatisticsOut,
)
from service.schemas.sweep.sweep import trusted_sweep
from service.storage.database.database import Database
from service.storage.searching.narrowing import slow_parts
from service.storage.searching.sources import OF_JOB_ROWS, OF_SOLUTION_ROWS, Source, with_names
from service.storage.searching.statistics import Facet, Statistic, facets, statistics
from service.storage.sweeps.point_reader import PointReader
from service.storage.sweeps.point_tables import PointTable

router = APIRouter(prefix="/v1")

_ALL_POINTS = (("?where", "points have no index: all that are computed are read"),)

FacetsAsked = Annotated[Asked[FacetsQuery], Depends(asked_of(FacetsQuery))]
StatisticsAsked = Annotated[Asked[StatisticsQuery], Depends(asked_of(StatisticsQuery))]


@router.get(
    "/solutions/facets",
    tags=["solutions"],
    response_model=FacetsOut | QueryEstimateOut,
    responses=refusals(),
    openapi_extra=query_parameters(FacetsQuery, "by"),
)
@heavy
def get_solution_facets(request: Request, asked: FacetsAsked, inside: Inside) -> Response:
    """Count how often each value of some facts occurs among the solutions that match."""
    return _facets_of_rows(asked, inside.database, OF_SOLUTION_ROWS)


@router.get(
    "/jobs/facets",
    tags=["jobs"],
    response_model=FacetsOut | QueryEstimateOut,
    responses=refusals(),
    openapi_extra=query_parameters(FacetsQuery, "by"),
)
@heavy
def get_job_facets(request: Request, asked: FacetsAsked, inside: Inside) -> Response:
    """Count how often each value of some facts occurs among the jobs that match."""
    return _facets_of_rows(asked, inside.database, OF_JOB_ROWS)


@router.get(
    "/sweeps/{sweep_id}/points/facets",
    tags=["sweeps"],
    response_model=FacetsOut | QueryEstimateOut,
    responses=refusals(404),
    openapi_extra=query_parameters(FacetsQuery, "by"),
)
@heavy
def get_point_facets(request: Request, sweep_id: SweepId, asked: FacetsAsked, inside: Inside) -> Response:
    """Count how often each value occurs among the computed points that match."""
    record = inside.sweeps.get(sweep_id)
    sweep = trusted_sweep(record.document)
    analysis = read_facets(asked, vocabulary_of(sweep))
    if asked.parameters.estimate:
        return estimate_of(_ALL_POINTS)
    table = PointTable(PointReader(inside.sweeps, record.id, sweep, with_series=False), analysis.conditions)
    return _facets(table.facet(subject.name, asked.parameters.limit) for subject in analysis.by)


@router.get(
    "/solutions/statistics",
    tags=["solutions"],
    response_model=StatisticsOut | QueryEstimateOut,
    responses=refusals(),
    openapi_extra=query_parameters(StatisticsQuery, "of"),
)
@heavy
def get_solution_statistics(request: Request, asked: StatisticsAsked, inside: Inside) -> Response:
    """Tell how numbers of the solutions that match are spread: extremes, quartiles, histograms."""
    return _statistics_of_rows(asked, inside.database, OF_SOLUTION_ROWS)


@router.get(
    "/jobs/statistics",
    tags=["jobs"],
    response_model=StatisticsOut | QueryEstimateOut,
    responses=refusals(),
    openapi_extra=query_parameters(StatisticsQuery, "of"),
)
@heavy
def get_job_statistics(request: Request, asked: StatisticsAsked, inside: Inside) -> Response:
    """Tell how numbers of the jobs that match are spread: extremes, quartiles, histograms."""
    return _statistics_of_rows(asked, inside.database, OF_JOB_ROWS)


@router.get(
    "/sweeps/{sweep_id}/points/statistics",
    tags=["sweeps"],
    response_model=StatisticsOut | QueryEstimateOut,
    responses=refusals(404),
    openapi_extra=query_parameters(StatisticsQuery, "of"),
)
@heavy
def get_point_statistics(
    request: Request, sweep_id: SweepId, asked: StatisticsAsked, inside: Inside
) -> Response:
    """Tell how numbers of the computed points that match are spread."""
    record = inside.sweeps.get(sweep_id)
    sweep = trusted_sweep(record.document)
    analysis = read_statistics(asked, vocabulary_of(sweep))
    if asked.parameters.estimate:
        return estimate_of(_ALL_POINTS)
    table = PointTable(PointReader(inside.sweeps, record.id, sweep, with_series=False), analysis.conditions)
    by, query = analysis.by[0].name if analysis.by else None, asked.parameters
    return _statistics(
        statistic
        for subject in analysis.of
        for statistic in table.statistics(subject.name, by, bins=query.bins, groups=query.limit)
    )


def _facets_of_rows(asked: Asked[FacetsQuery], database: Database, source: Source) -> Response:
    analysis = read_facets(asked, with_names(database, source).vocabulary)
    if asked.parameters.estimate:
        return estimate_of(slow_parts(source, analysis.conditions, read={"?by": analysis.by}))
    with database.search() as session:
        return _facets(facets(session, source, analysis.conditions, analysis.by, asked.parameters.limit))


def _statistics_of_rows(asked: Asked[StatisticsQuery], database: Database, source: Source) -> Response:
    analysis, query = read_statistics(asked, with_names(database, source).vocabulary), asked.parameters
    by = analysis.by[0] if analysis.by else None
    if query.estimate:
        read = {"?of": analysis.of, "?by": analysis.by}
        return estimate_of(slow_parts(source, analysis.conditions, read=read))
    with database.search() as session:
        found = statistics(
            session, source, analysis.conditions, analysis.of, by, bins=query.bins, groups=query.limit
        )
        return _statistics(found)


def _facets(found: Iterable[Facet]) -> Response:
    shown = []
    for facet in found:
        values = [FacetValueOut(value=value, count=count) for value, count in facet.values]
        shown.append(FacetOut(by=facet.name, values=values, others=facet.others))
    return json_response(FacetsOut(facets=shown))


def _statistics(found: Iterable[Statistic]) -> Response:
    return json_response(StatisticsOut(items=[_statistic(each) for each in found]))


def _statistic(found: Statistic) -> StatisticOut:
    histogram = HistogramOut(edges=list(found.edges), counts=list(found.counts)) if found.edges else None
    return StatisticOut(
        of=found.name,
        group=found.group,
        rows=found.rows,
        count=found.count,
        min=found.smallest,
        quartiles=found.quartiles,
        max=found.largest,
        histogram=histogram,
    )
