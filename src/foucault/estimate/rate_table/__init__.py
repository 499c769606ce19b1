"""Constant rates of a table: their likelihood, and the scatter beyond noise."""
