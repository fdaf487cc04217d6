"""Potentials whose numbers vary from point to point: verdicts, energies, programs for all of them."""
