"""Take a result away: calibrated logs, and files in the form of other programs.

One file per receiver. Each states the receiver's convention in the file it writes, and refuses
the coefficients that the receiver has no place for.
"""

from foucault.export.calibrated_log import Applied, calibrate_log
from foucault.export.receivers import RECEIVERS, write

__all__ = ["RECEIVERS", "Applied", "calibrate_log", "write"]
