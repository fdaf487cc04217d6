"""Examines a potential and a problem before a job is queued, and writes the results as documents."""
