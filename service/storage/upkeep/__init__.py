"""What an installation needs from day to day: counts, retention, backups."""
