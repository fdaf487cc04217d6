"""The endpoints of one sweep and its points, and the list of sweeps."""
