"""The workers: claim jobs and run the numerics in killable child processes."""
