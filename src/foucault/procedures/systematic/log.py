"""How a campaign describes the log of a systematic calibration."""

from __future__ import annotations

from foucault.tables import Log

LOG_TABLE = """\
[log]
file = "log.csv"                        # relative to this file
# CSV or spaced text (.gz too), Parquet, .npy, .npz, .mat and binary records can be read.
# Columns by name, or by number from 0 in a file without a header; "-gy" flips a sign.
# Without a time column write rate = "100 Hz" instead of `time`.
time = { column = "time", unit = "s" }
gyro = { columns = ["gyro_x", "gyro_y", "gyro_z"], unit = "rad/s" }
accel = { columns = ["accel_x", "accel_y", "accel_z"], unit = "m/s^2" }
# Increments, better than rates where the instrument turns:
#   gyro = { columns = [...], unit = "0.1 arcsec", kind = "increment" }
#   accel = { columns = [...], unit = "m/s", kind = "increment" }
"""
"""[log] of the template."""

INCREMENTS_TABLE = """\
[log]
file = "log.csv"                        # relative to this file; it says itself what it holds
"""
"""[log] of a simulated log: means over the intervals."""


def log_table(log: Log | None = None) -> str:
    """Write the table [log] of the template, or for a simulated `log` [SI]."""
    return LOG_TABLE if log is None else INCREMENTS_TABLE
