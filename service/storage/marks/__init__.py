"""Reads and writes the labels and notes of jobs, solutions and sweeps, within the caller's transaction."""
