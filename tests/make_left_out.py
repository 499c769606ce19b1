"""What is left out of a calibration, put into samples by formulas that are not its columns."""

from __future__ import annotations

import numpy as np

from foucault.tables import Log


def ramp(log: Log) -> np.ndarray:
    """From -1/2 at the start of a log to 1/2 at its end, shape (n, 1)."""
    return np.asarray((log.time - log.time[0]) / (log.time[-1] - log.time[0]) - 0.5)[:, None]
