"""Commands that ask a service over HTTP, by the Python client."""
