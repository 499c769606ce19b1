"""Kernels as plain Python, those that they call too."""

from __future__ import annotations

import sys
from types import FunctionType, ModuleType
from typing import Any


def kernel(form: str, module: ModuleType, name: str) -> Any:
    """Return a kernel of a module in a form, "compiled" or "python"."""
    return getattr(module, name) if form == "compiled" else _plain(module.__name__, {})[name]


def _plain(name: str, known: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the names of a module with every kernel in plain Python."""
    if name in known:
        return known[name]
    out = known[name] = dict(vars(sys.modules[name]))
    for key, thing in list(out.items()):
        if hasattr(thing, "py_func"):
            f = thing.py_func
            out[key] = FunctionType(f.__code__, _plain(f.__module__, known), key)
    return out
