"""Who delivers job ids to the runner."""
