"""Compiled loops: recursions over samples. Arrays and scalars in, arrays out; numba only.

Every kernel has a slow, obvious twin in ``tests/reference.py`` or beside its test, and is tested
compiled and as ``.py_func``. `kernel` is the one decorator. Compiled code is cached on disk in a
folder keyed by a hash of all kernel sources, because numba's own cache does not see an edit in
another file.

What takes long to compile: an array assigned to a slice (``a[i] = b`` brings in the text of its
error, two seconds), `np.eye`, a number written as an argument of a kernel (it is compiled for that
number, and again for the others), and every function that is not `inlined`. Loops cost nothing.
What takes long to run: an array that an `inlined` part last uses in one arm of a branch. Its
references are then counted, atomically, at every call.
What a procedure needs is compiled on two cores: see `ahead`.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba.core.caching import FunctionCache
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys

TRIED = (0, 68)
"""The newest Numba that `compiling` was tried with: a newer one compiles as it does by itself."""

KernelCompiler: Any = Compiler
PartCompiler: Any = Compiler
if numba.version_info.short <= TRIED:
    from foucault.kernels.compiling import KernelCompiler, PartCompiler


def _cache_folder() -> str:
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return str(Path(platformdirs.user_cache_dir("foucault")) / "kernels" / digest.hexdigest()[:16])


_FOLDER = _cache_folder()


def cache_folder() -> Path:
    """Return where compiled code is kept."""
    return Path(numba.config.CACHE_DIR or _FOLDER)


class _Cache(FunctionCache):  # type: ignore[misc]  # numba has no types
    """The cache of numba, without all that numba first loads in order to compile.

    What is compiled needs none of it but the memory of arrays; what is not asks for it itself.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what is compiled for a signature, or None."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


class _Part(CPUDispatcher):  # type: ignore[misc]  # numba has no types
    """Compiled code that Python cannot call."""

    def __call__(self, *given: Any) -> Any:
        return self.py_func(*given)


def kernel(function: Any) -> Any:
    """Compile `function` on first use: cached on disk, without the GIL, IEEE arithmetic.

    No fastmath: a NaN must stay a NaN, because a bad row is reported through it.
    """
    return _compiled(function)


def part(function: Any, **more: Any) -> Any:
    """Compile `function` as `kernel` does, for other kernels alone: from Python it runs as Python.

    What would take its arguments from Python is a tenth of the time to compile.
    """
    made = _compiled(function, no_cpython_wrapper=True, pipeline_class=PartCompiler, **more)
    made.__class__ = _Part
    return made


def inlined(function: Any) -> Any:
    """Compile a `part` into its callers: every array that is handed on costs.

    For the parts of one long loop.
    """
    return part(function, forceinline=True)


def summed(function: Any) -> Any:
    """Compile a `part`, a product and the sum it goes into rounded once (NaN stays NaN)."""
    return part(function, fastmath={"contract"})


def fused(function: Any) -> Any:
    """Compile as `inlined`, a product and the sum it goes into rounded once (NaN stays NaN)."""
    made = _compiled(function, forceinline=True, no_cpython_wrapper=True, fastmath={"contract"})
    made.__class__ = _Part
    return made


def reduction(function: Any) -> Any:
    """Compile a plain sum as `kernel` does, its terms added in any order (NaN stays NaN)."""
    return _compiled(function, fastmath={"reassoc", "contract"})


def _compiled(function: Any, **more: Any) -> Any:
    previous = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = previous or _FOLDER  # numba reads it while decorating
    more = {"pipeline_class": KernelCompiler, "no_cfunc_wrapper": True} | more
    try:
        made = numba.njit(nogil=True, error_model="numpy", **more)(function)
        if not numba.config.DISABLE_JIT:
            made._cache = _Cache(function)
        return made
    finally:
        numba.config.CACHE_DIR = previous
