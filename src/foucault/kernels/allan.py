"""Mean squares of phase differences, from which the Allan family of variances is made.

The phase ``x_k = sum_{i<k} (y_i - offset)`` is in units of one sample interval. The sums run
over blocks that stay in the cache for all averaging factors in turn; that also keeps rounding
from growing with the length of the log.
"""

import numpy as np

from foucault.kernels import kernel, reduction


@kernel
def integrate(y, offset, phase):
    """Sum the samples, with `offset` removed so that the sums stay small.

    Parameters: y (n,); offset: scalar. Fills phase (n + 1,), the first 0: from NumPy it has large
    pages. What rounding adds is white noise of the rate, 1e-16 of the largest phase: 1e-12 of the
    noise after 1e8 samples.
    """
    phase[0] = 0.0
    total = 0.0
    for i in range(y.size):
        total += y[i] - offset
        phase[i + 1] = total


@reduction
def overlapping(phase, factors):
    """Average the squares of all second differences of the phase, for every factor.

    Parameters: phase (n + 1,); factors (k,) integers m with 2 m <= n. Returns the means of
    (x_{i+2m} - 2 x_{i+m} + x_i)^2, shape (k,).
    """
    block = 32768
    sums = np.zeros(factors.size)
    for start in range(0, phase.size, block):
        for j in range(factors.size):
            m = factors[j]
            count = min(block, phase.size - 2 * m - start)
            if count > 0:
                a = phase[start : start + count]
                b = phase[start + m : start + m + count]
                c = phase[start + 2 * m : start + 2 * m + count]
                part = 0.0
                for i in range(count):
                    d = c[i] - 2.0 * b[i] + a[i]
                    part += d * d
                sums[j] += part
    return sums / (phase.size - 2 * factors)


@reduction
def hadamard(phase, factors):
    """Average the squares of all third differences of the phase, for every factor.

    Parameters: phase (n + 1,); factors (k,) integers m with 3 m <= n. Returns the means of
    (x_{i+3m} - 3 x_{i+2m} + 3 x_{i+m} - x_i)^2, shape (k,).
    """
    block = 32768
    sums = np.zeros(factors.size)
    for start in range(0, phase.size, block):
        for j in range(factors.size):
            m = factors[j]
            count = min(block, phase.size - 3 * m - start)
            if count > 0:
                a = phase[start : start + count]
                b = phase[start + m : start + m + count]
                c = phase[start + 2 * m : start + 2 * m + count]
                d = phase[start + 3 * m : start + 3 * m + count]
                part = 0.0
                for i in range(count):
                    e = (d[i] - a[i]) - 3.0 * (c[i] - b[i])
                    part += e * e
                sums[j] += part
    return sums / (phase.size - 3 * factors)


@kernel
def modified(phase, factors):
    """Average the squares of all means over m second differences, for every factor m.

    Parameters: phase (n + 1,); factors (k,) integers m with 3 m <= n + 1. Returns the means of
    (1/m sum_{h<m} (x_{i+h+2m} - 2 x_{i+h+m} + x_{i+h}))^2, shape (k,). The moving sum starts
    afresh every m terms (at least 4096), so that rounding does not accumulate.
    """
    out = np.empty(factors.size)
    for j in range(factors.size):
        m = factors[j]
        terms = phase.size - 3 * m + 1
        stretch = max(4096, m)
        total = 0.0
        for start in range(0, terms, stretch):
            moving = 0.0
            for i in range(start, start + m):
                moving += phase[i + 2 * m] - 2.0 * phase[i + m] + phase[i]
            part = moving * moving
            for i in range(start, min(start + stretch, terms) - 1):
                moving += (phase[i + 3 * m] - phase[i]) - 3.0 * (phase[i + 2 * m] - phase[i + m])
                part += moving * moving
            total += part
        out[j] = total / terms / m / m
    return out
