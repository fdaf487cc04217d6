"""The wire format: HTTP bodies and job payloads alike."""
