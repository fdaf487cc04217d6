"""Computes verdicts for waiting clients in child processes, in a fair order."""
