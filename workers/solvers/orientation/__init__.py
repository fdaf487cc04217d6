"""The attitude of the body in space along a computed motion."""
