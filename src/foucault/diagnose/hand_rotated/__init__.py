"""A session by hand: what is wrong with it, its checks, and the parts of its report."""
