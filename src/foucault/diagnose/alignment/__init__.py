"""Whether an alignment can be trusted, and agrees with another."""
