"""A calibration on a table: input, checks, hints and the parts of its report."""
