"""Motions on which a slave is calibrated in its vehicle."""
