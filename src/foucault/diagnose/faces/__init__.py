"""Rests on the faces of a cube: which face, which moves between them, what they show."""
