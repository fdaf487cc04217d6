"""Recognises errors of the driver of Postgres without loading it: where it is not loaded there are none."""

import sys
from typing import TYPE_CHECKING, TypeGuard

if TYPE_CHECKING:
    import psycopg


def is_postgres_error(error: object) -> "TypeGuard[psycopg.Error]":
    """Tell whether an error is one of the driver."""
    driver = sys.modules.get("psycopg")
    return driver is not None and isinstance(error, driver.Error)
