"""Operations: metrics, retention, backups, and which services and workers are alive."""
