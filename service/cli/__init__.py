"""The command ``polhode``."""
