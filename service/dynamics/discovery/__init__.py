"""Tools of a search for integrable cases: integrals judged and found, potentials found, cases named."""
