"""Errors of a navigation: against a reference, standing still, and what they come from."""
