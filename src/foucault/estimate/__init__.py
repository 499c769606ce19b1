"""From a `Problem` or a linear system to an `Estimate`: coefficients with covariance and status.

A file has the name of what is calibrated or sought; the solution as its source has it, kept for
comparison, stands beside the best one.
"""
