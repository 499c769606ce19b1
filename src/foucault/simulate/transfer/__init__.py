"""A master INS and a slave IMU on one vehicle."""
