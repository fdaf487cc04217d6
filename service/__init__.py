"""The service: reads problems, stores them, and serves their solutions over HTTP."""
