"""In which order a north seeker's base stops: named orders, and a search for better ones."""
