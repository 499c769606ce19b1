"""The command line: parse, call, print. Nothing is computed here."""

from __future__ import annotations

import os
import sys

# Our matrices are small: a second BLAS thread doubles the processor time and gains nothing, and
# the last digits of its sums are others. NumPy reads this when it is first imported; afterwards
# the environment must not say what is not so (`cluster` compares it between machines).
if "numpy" not in sys.modules:
    for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(_name, "1")
# Else the first of our models looks for plugins in every package that is installed.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")

try:
    from foucault.cli.app import app, main
except KeyboardInterrupt:  # before anybody could hear it
    raise SystemExit(130) from None

__all__ = ["app", "main"]
