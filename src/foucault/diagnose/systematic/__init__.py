"""Rests, turns and spins of a systematic calibration: found, judged and reported."""
