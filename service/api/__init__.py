"""The HTTP API: routes, authentication, request and answer formats, errors."""
