"""The SQLAlchemy tables, the same on SQLite and Postgres."""
