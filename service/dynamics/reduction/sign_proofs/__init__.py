"""Proves the sign of p² on whole stretches of a loop, by outward-rounded doubles and by balls."""
