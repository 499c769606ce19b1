"""A platform tumble: input, checks, and what its motion shows."""
