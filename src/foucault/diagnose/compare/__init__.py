"""Results of one instrument over time, or of several, against their joint uncertainty."""
