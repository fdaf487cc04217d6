"""One router per resource; errors and dependencies."""
