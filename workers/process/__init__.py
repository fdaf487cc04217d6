"""The worker process: it claims jobs, has children compute them, and keeps the leases."""
