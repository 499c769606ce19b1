"""Solve with a triangle that is a band, for many columns at once."""

from foucault.kernels import kernel, part


@part
def _take(W, i, j, n, u, v, w, x):
    """Take u, v, w and x times rows j, j + n .. j + 3 n of W off its row i."""
    for c in range(W.shape[1]):
        W[i, c] -= u * W[j, c] + v * W[j + n, c] + w * W[j + 2 * n, c] + x * W[j + 3 * n, c]


@kernel
def forward(L, W):
    """Solve with a banded triangle, L (m, b) column by column; W (m, c) is overwritten."""
    for i in range(W.shape[0]):
        j = max(0, i - L.shape[1] + 1)
        while j + 3 < i:
            _take(W, i, j, 1, L[j, i - j], L[j + 1, i - j - 1], L[j + 2, i - j - 2],
                  L[j + 3, i - j - 3])  # fmt: skip
            j += 4
        while j < i:
            _take(W, i, j, 0, L[j, i - j], 0.0, 0.0, 0.0)
            j += 1
        one = 1.0 / L[i, 0]
        for c in range(W.shape[1]):
            W[i, c] *= one


@kernel
def backward(L, W):
    """Solve with the transpose of a banded triangle, as `forward`."""
    for i in range(W.shape[0] - 1, -1, -1):
        last = min(W.shape[0] - 1, i + L.shape[1] - 1)
        j = i + 1
        while j + 3 <= last:
            _take(W, i, j, 1, L[i, j - i], L[i, j - i + 1], L[i, j - i + 2], L[i, j - i + 3])
            j += 4
        while j <= last:
            _take(W, i, j, 0, L[i, j - i], 0.0, 0.0, 0.0)
            j += 1
        one = 1.0 / L[i, 0]
        for c in range(W.shape[1]):
            W[i, c] *= one
