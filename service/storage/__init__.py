"""SQLAlchemy tables, sessions, job and result stores, the trajectory codec."""
