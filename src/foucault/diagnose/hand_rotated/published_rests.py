"""Find rests as the published hand-rotated method does, for comparison with other programs.

A sample is at rest when the norm of the three accelerometer variances in the window around it
is below a multiple of that of an initial rest.
"""

from __future__ import annotations

import numpy as np

from foucault.diagnose.rests import Rests, quiet_runs
from foucault.kernels.moving import moving_moments
from foucault.tables import Log


def find_published_rests(
    log: Log, *, initial_rest: float, factor: float, window: int, shortest: int
) -> Rests:
    """Find the rests of a log by a multiple of the variance of its beginning.

    `log`: readings with accelerometers [SI]; `initial_rest`: length of the rest at the start of
    the log [s]; `factor`: threshold over the variance of that rest [1]; `window`: samples of the
    moving window, odd [1]; `shortest`: fewest samples of a rest [1].

    References
    ----------
    .. [1] D. Tedaldi, A. Pretto, E. Menegatti, ICRA 2014, eqs. (11), (12).
    """
    assert log.accel is not None
    _, variance = moving_moments(np.ascontiguousarray(log.accel), window)
    level = np.linalg.norm(variance, axis=1)
    start = log.accel[: int(np.searchsorted(log.time, log.time[0] + initial_rest))]
    reference = float(np.linalg.norm(start.var(axis=0, ddof=1)))
    first, last = quiet_runs(level < factor * reference, shortest)
    relative = np.sqrt(level / reference)
    none = np.full(len(level), np.nan)
    return Rests(first, last, relative, relative, none, float(np.sqrt(factor)), window)
