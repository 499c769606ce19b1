"""Constant rates of a table: steps, norms, and the report of both."""
