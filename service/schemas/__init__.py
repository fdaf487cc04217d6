"""The documents of the HTTP API, files and stored jobs: reading, checking and writing them."""
