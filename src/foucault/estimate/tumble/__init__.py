"""A torqued cluster in continuous rotation: calibrated and aligned at once."""
