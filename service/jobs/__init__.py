"""The rules for jobs: states, legal moves, leases, retries, and the protocol of the store. No I/O."""
