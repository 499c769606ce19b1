"""A slave's errors from what its master says."""
