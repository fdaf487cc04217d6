"""The life of a job: states, legal moves, leases, retries. Pure, plus the store's protocol."""
