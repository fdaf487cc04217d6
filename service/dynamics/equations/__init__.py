"""The differential equations: compatibility, Euler-Poisson, and their integrals."""
