"""Processing that wraps every request: logging, metrics, authentication, error handling."""
