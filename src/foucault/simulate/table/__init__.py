"""Instruments on a table: means of many at once, or the log of one."""
