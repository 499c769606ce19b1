"""Moving statistics over a window of samples."""

import numpy as np

from foucault.kernels import kernel


@kernel
def moving_moments(x, window):
    """Compute the mean and the variance (ddof 1) of every window, centred, per column.

    Parameters: x (n, c); window: odd number of samples. Returns mean (n, c) and variance
    (n, c), NaN in the half window at either end. The running sums start afresh every window
    from exact sums about a nearby reference, so that rounding does not accumulate.
    """
    n, columns = x.shape
    half = window // 2
    mean = np.full((n, columns), np.nan)
    variance = np.full((n, columns), np.nan)
    if n < window:
        return mean, variance
    for c in range(columns):
        reference = 0.0
        total = 0.0
        square = 0.0
        for i in range(half, n - half):
            if (i - half) % window == 0:
                reference = x[i, c]
                total = 0.0
                square = 0.0
                for k in range(i - half, i + half + 1):
                    d = x[k, c] - reference
                    total += d
                    square += d * d
            else:
                d = x[i + half, c] - reference
                total += d
                square += d * d
                d = x[i - half - 1, c] - reference
                total -= d
                square -= d * d
            mean[i, c] = reference + total / window
            v = (square - total * total / window) / (window - 1)
            variance[i, c] = 0.0 if v < 0.0 else v  # max() would turn a NaN into a zero
    return mean, variance
