"""The mathematics of solving a problem. No I/O."""
