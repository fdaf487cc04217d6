from tests.support.databases import database, jobs, solutions, template, url

__all__ = ["database", "jobs", "solutions", "template", "url"]
