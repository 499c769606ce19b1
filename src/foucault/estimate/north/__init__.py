"""North from the stops of one gyro, and the calibration of what seeks it."""
