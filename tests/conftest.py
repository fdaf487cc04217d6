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
