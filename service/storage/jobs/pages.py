"""Reads a page of jobs, of all or of some source."""

from service.jobs.records import JobPage
from service.schemas.query.conditions import ListQuery
from service.storage.database.database import Database
from service.storage.database.paging import rows_of_page
from service.storage.jobs.records import job_of
from service.storage.marks.mark_rows import marks_of
from service.storage.searching.pages import find
from service.storage.searching.sources import Source
from service.storage.tables.jobs import JobRow


def page_of_jobs(database: Database, source: Source, query: ListQuery) -> JobPage:
    """Return one page of the jobs that match; only the wanted columns of them, if there are any."""
    with database.search() as session:
        found = find(session, source, query)
        rows = [] if query.columns else rows_of_page(session, JobRow, found.ids)
        jobs = tuple(map(job_of, rows, marks_of(session, rows)))
        return JobPage(jobs, found.total, found.values, found.next)
