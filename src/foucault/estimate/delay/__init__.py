"""The time offset of two instruments on one body."""
