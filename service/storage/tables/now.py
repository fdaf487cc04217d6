"""The instant of the database's clock as an SQL expression, in seconds since 1970."""

from sqlalchemy import Double
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement


class DatabaseNow(FunctionElement[float]):
    """The instant at which the statement runs."""

    type = Double()
    inherit_cache = True


@compiles(DatabaseNow, "sqlite")
def _sqlite(element: DatabaseNow, compiler: SQLCompiler, **_: object) -> str:
    # unixepoch('subsec') would need SQLite 3.42; Julian days resolve 0.04 ms.
    return "((julianday('now') - 2440587.5) * 86400.0)"


@compiles(DatabaseNow, "postgresql")
def _postgresql(element: DatabaseNow, compiler: SQLCompiler, **_: object) -> str:
    # Not now(), which is the start of the transaction.
    return "CAST(EXTRACT(EPOCH FROM clock_timestamp()) AS double precision)"
