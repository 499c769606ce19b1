"""Allan deviations, and the noise that explains them."""
