"""The linear equations of perturbations that leave the plane of a motion, by compiled code."""
