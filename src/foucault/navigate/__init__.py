"""Alignment and strapdown navigation: from a log to attitude, velocity and position."""
