"""Rests on the six faces, and turns between them."""
