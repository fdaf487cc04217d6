"""Periodic planar motions as proven enclosures: every number is a ball that contains the true one."""
