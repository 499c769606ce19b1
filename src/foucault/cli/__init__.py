"""The command line: parse, call, print. Nothing is computed here."""

from __future__ import annotations

import os

# Our matrices are small: a second BLAS thread doubles the processor time and gains nothing.
# Must be set before NumPy is first imported.
for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from foucault.cli.app import app, main  # noqa: E402

__all__ = ["app", "main"]
