"""A slave beside its master: stretches of motion, causes of disagreement, and the report."""
