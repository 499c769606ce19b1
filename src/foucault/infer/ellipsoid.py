"""An ellipsoid through readings of a vector whose length is always the same."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray

SPREAD = 1.5  # An ellipsoid of more unequal axes is an accident of the coverage [1].


def ellipsoid(read: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return A_0 (symmetric) and h of ``|A_0^-1 (read - h)| = 1`` by linear equations, or a sphere.

    `read` (n, 3): readings of a vector of one length [any unit]. Returns (3, 3) and (3,) [as read].
    """
    middle, size = read.mean(axis=0), float(read.std())
    y = (read - middle) / size
    # y' Q y + 2 q'y = c with trace Q = 3: Q = I + traceless part.
    pairs = [y[:, 0] ** 2 - y[:, 2] ** 2, y[:, 1] ** 2 - y[:, 2] ** 2, 2 * y[:, 0] * y[:, 1],
             2 * y[:, 0] * y[:, 2], 2 * y[:, 1] * y[:, 2]]  # fmt: skip
    linear = [*(2 * y).T, -np.ones(len(y))]
    square = -np.sum(y**2, axis=1)
    for some in (pairs, []):
        x = np.linalg.lstsq(np.column_stack([*some, *linear]), square, rcond=1e-9)[0]
        a, b, c, d, e = x[:5] if some else np.zeros(5)
        Q = np.array([[1 + a, c, d], [c, 1 + b, e], [d, e, 1 - a - b]])
        values, axes = np.linalg.eigh(Q)
        if values[0] <= 0 or values[2] > SPREAD**2 * values[0]:
            continue
        centre = -np.linalg.solve(Q, x[-4:-1])
        radius = float(x[-1] + centre @ Q @ centre)
        if radius > 0:
            root = axes @ np.diag(np.sqrt(radius / values)) @ axes.T
            return size * root, middle + size * centre
    return size * np.sqrt(3.0) * np.eye(3), middle
