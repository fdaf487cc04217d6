"""The angular part V1[F] of an admissible potential, for any function F of the curve."""
