"""Jobs in SQL: submitting, claiming, state changes, finishing, and delivery to workers."""
