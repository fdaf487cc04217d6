"""States problems, stores them and serves their solutions."""
