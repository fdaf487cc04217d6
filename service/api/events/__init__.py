"""Follows jobs, sweeps and the installation for streams of events: one poll of the database for all."""
