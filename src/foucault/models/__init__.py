"""What is true: the Earth, instruments and their errors, rigs, and what each of them would say."""
