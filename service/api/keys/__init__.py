"""Authentication by API keys, roles of endpoints, and limits per key."""
