"""Solutions, their arrays, and what tiers were measured to reach."""
