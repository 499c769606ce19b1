"""Trials on a device of CUDA, one in each of its threads: the functions of `trials` themselves.

Nothing of a model or of its solution is written here. Arrays have the trial last, so that threads
side by side read and write side by side.
"""

from __future__ import annotations

import warnings
from threading import Lock
from types import FunctionType
from typing import Any

import numpy as np
from numba import cuda

from foucault.kernels import trials

warnings.filterwarnings("ignore", "Grid size .* under-utilization")  # several run at once

THREADS = 32
"""Threads in a block of the device: few, so that thousands of trials reach all of it [1]."""

_ONE = Lock()
"""Numba's simulator runs one kernel at a time; a device is told of one at a time, and runs many."""


def device(function: Any) -> Any:
    """Compile the source of a kernel, and of those that it calls, for the device."""
    plain = getattr(function, "py_func", function)
    called = {name: plain.__globals__.get(name) for name in plain.__code__.co_names}
    parts = {name: device(one) for name, one in called.items() if hasattr(one, "py_func")}
    copy = FunctionType(plain.__code__, plain.__globals__ | parts, plain.__name__)
    return cuda.jit(device=True)(copy)


_solve = device(trials.solve)


def _each(width, column, J, H, y, S, spread, d, most, small, cov, left, good,
          j, row, g, A, V, dense):  # fmt: skip
    t = cuda.grid(1)
    if t < good.shape[0]:  # the last block has threads to spare
        good[t] = _solve(
            (width, column, J, H), y[:, t], S[t if spread else 0], spread, d[:, t],
            most, small, j[:, :, t], left[:, t], row[:, t], g[:, t], A[:, :, t], V[:, :, t],
            dense[:, :, t],
        )  # fmt: skip
        for a in range(cov.shape[0]):
            for b in range(cov.shape[1]):
                cov[a, b, t] = V[a, b, t]


_launch = cuda.jit(_each)


def missing() -> str:
    """Return why there is no device, empty where there is one."""
    if cuda.is_available():
        return ""
    return " ".join(str(cuda.cuda_error() or "its compiler NVVM is missing").split()).rstrip(".")


def solve_batch(
    width, column, J, H, y, S, spread, d, most, small, cov, left, good
):  # fmt: skip
    """Do what `trials.solve_batch` does, on the device; arguments and shapes are the same."""
    stream, (b, m), p = cuda.stream(), d.shape, cov.shape[1]

    def there(a: Any) -> Any:
        return cuda.to_device(np.ascontiguousarray(a), stream=stream)

    def room(*shape: int) -> Any:
        return cuda.device_array((*shape, b), stream=stream)

    d_, cov_, left_, good_ = there(d.T), room(p, p), room(y.shape[1]), there(good)
    given = [there(a) for a in (width, column, J, H, y.T, S)]
    work = [room(*J.shape), room(m), room(m), room(m, m), room(m, m)]
    work += [room(y.shape[1] if spread else 1, m)]
    with _ONE:
        _launch[-(-b // THREADS), THREADS, stream](
            *given, spread, d_, most, small, cov_, left_, good_, *work
        )
    found = [a.copy_to_host(stream=stream) for a in (d_, left_, cov_, good_)]
    stream.synchronize()
    d[:], left[:], cov[:], good[:] = (np.moveaxis(a, -1, 0) for a in found)
