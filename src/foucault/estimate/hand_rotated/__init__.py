"""Rests by hand and the turns between them."""
