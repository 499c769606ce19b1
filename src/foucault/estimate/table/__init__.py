"""Readings on a table: of one instrument, or of many in one batch."""
