"""Stores jobs, solutions, sweeps and keys in SQLite or Postgres through SQLAlchemy."""
