"""A recorded session by hand: input, checks, and the parts of its report."""
