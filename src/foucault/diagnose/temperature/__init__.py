"""Whether coefficients follow the functions of temperature that were fitted."""
