"""The answers of the API as pydantic models: verdicts, jobs, solutions, sweeps, errors."""
