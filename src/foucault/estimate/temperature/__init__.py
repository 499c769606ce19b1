"""Coefficients as functions of temperature, and how many terms they need."""
