"""Rests of an instrument on a table: found, matched to the plan, and measured."""
