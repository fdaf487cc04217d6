"""The algebras a formula is evaluated in, one file each."""
