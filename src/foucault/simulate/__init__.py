"""A plan and what is true make a log, with the truth beside it. Never imports `estimate`."""
