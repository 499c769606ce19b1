"""What a north seeker's stops show, whether they agree, and what made them disagree."""
