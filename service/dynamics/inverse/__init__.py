"""The inverse problem: F and G of V = V1[F] + Q G from V, and the nearest admissible polynomial."""
