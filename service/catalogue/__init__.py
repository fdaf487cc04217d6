"""The catalogue for clients: families of potentials, and named cases of the literature."""
