"""Follows jobs, sweeps and the installation for streams of events: one look at the database for all."""
