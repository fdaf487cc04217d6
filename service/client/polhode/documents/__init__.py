"""Documents on their way to the service: problems, sweeps, exact numbers."""
