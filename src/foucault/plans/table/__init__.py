"""Positions on a table: named sets, how good they are, and a search for better ones."""
