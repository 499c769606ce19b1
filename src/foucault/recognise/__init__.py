"""From a bare file to what it holds: columns, units, axes, and what was done with the instrument.

Titles are read first (`titles`), and what they leave open is asked of the numbers (`physics`). What
fits in two ways is a question, not a guess.
"""
