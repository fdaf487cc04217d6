from tests.support.api import app, client, stored
from tests.support.databases import database, jobs, solutions, template, url

__all__ = ["app", "client", "database", "jobs", "solutions", "stored", "template", "url"]
