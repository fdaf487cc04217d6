"""All planar motions of one potential over a range of λ, with the values of λ where their windows change."""
