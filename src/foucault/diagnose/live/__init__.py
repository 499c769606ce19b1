"""What is told while a session is being recorded."""
