from hypothesis import settings

from tests.support.databases import (
    database,
    jobs,
    postgres,
    postgres_template,
    postgres_url,
    solutions,
    sqlite_template,
    sqlite_url,
    url,
)

# How long an example takes says something about the machine, and nothing about a law.
settings.register_profile("polhode", deadline=None)
settings.load_profile("polhode")

__all__ = [
    "database",
    "jobs",
    "postgres",
    "postgres_template",
    "postgres_url",
    "solutions",
    "sqlite_template",
    "sqlite_url",
    "url",
]
