"""Documents of studies: questions about integrals, potentials and numbers."""
