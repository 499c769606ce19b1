"""From a `Problem` or a linear system to an `Estimate`: coefficients with covariance and status.

Files here hold for any instrument. A folder has the name of what is calibrated or sought, and its
files the same names in all: `likelihood` builds the problem of the maximum likelihood, `fit`
solves what has a way of its own, `scatter` estimates errors that nobody declared, `published` is
the solution as its source has it, kept for comparison.
"""
