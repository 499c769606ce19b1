"""Sequences of a systematic calibration: built in, from a file, or searched for."""
