"""Numba's compiler without what takes long and no kernel uses: a third of the first call's time.

A part is handed to its callers as text, to be made fast and into machine code there alone; what an
operator returns for types is found once, as is the size of a type, which is asked for the sake of
debuggers with every variable; and passes for closures, literals and branches that types decide are
left out. The numbers that a kernel returns are the same bits.
"""

from __future__ import annotations

import functools
from typing import Any

from llvmlite import binding, ir
from numba.core import typed_passes, types, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

UNUSED = (
    untyped_passes.WithLifting,
    untyped_passes.InlineClosureLikes,
    untyped_passes.RewriteSemanticConstants,
    untyped_passes.DeadBranchPrune,
    untyped_passes.RewriteDynamicRaises,
    untyped_passes.MakeFunctionToJitFunction,
    untyped_passes.InlineInlinables,
    untyped_passes.FindLiterallyCalls,
    untyped_passes.LiteralUnroll,
    untyped_passes.LiteralPropagationSubPipelinePass,
    typed_passes.InlineOverloads,
)

_Known: Any = types.BaseFunction
_call_type = _Known.get_call_type
_signatures: dict[Any, Any] = {}


def _known_call_type(function: Any, context: Any, given: Any, more: Any) -> Any:
    """Return the signature of a function of numba for types, which is long looked for."""
    key = function, tuple(given), tuple(more.items())
    if key not in _signatures:
        _signatures[key] = _call_type(function, context, given, more)
    return _signatures[key]


_size = functools.cache(lambda target, kind: int(kind.get_abi_size(target)))  # bytes of a type


class KernelCompiler(Compiler):  # type: ignore[misc]  # numba has no types
    """Compiles a kernel."""

    def __init__(self, typing: Any, target: Any, *rest: Any) -> None:
        super().__init__(typing, target, *rest)  # which refreshes both
        context = self.state.targetctx  # a copy, this kernel's own
        context.refresh = lambda: None
        context.get_abi_sizeof = functools.partial(_size, context.target_data)

    def compile_extra(self, function: Any) -> Any:
        """Compile a function."""
        before, _Known.get_call_type = _Known.get_call_type, _known_call_type
        try:
            return super().compile_extra(function)
        finally:
            _Known.get_call_type = before

    def define_pipelines(self) -> Any:
        """Return what is done, in order."""
        (line,) = super().define_pipelines()
        line.passes = [one for one in line.passes if one[0] not in UNUSED]
        line.finalize()
        return [line]


class _Text(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """A function for its callers to take in, and the pointers that numba wants to fill."""

    _final_module: Any

    def _optimize_final_module(self) -> None:
        self._shared_module = whole = self._final_module
        for function in whole.functions:
            if not function.is_declaration and function.linkage.name == "external":
                function.linkage = "linkonce_odr"
        rest = self._codegen._create_empty_module(self.name)
        for one in whole.global_variables:
            if one.name.startswith("_ZN08NumbaEnv"):
                pointer = ir.IntType(8).as_pointer()
                kept = ir.GlobalVariable(rest, pointer, one.name)
                kept.linkage, kept.initializer = "common", ir.Constant(pointer, None)
        self._final_module = binding.parse_assembly(str(rest))


class PartCompiler(KernelCompiler):
    """Compiles a part of kernels."""

    def __init__(self, typing: Any, target: Any, *rest: Any) -> None:
        super().__init__(typing, target, *rest)
        self.state.library = _Text(target.codegen(), f"part {id(self)}")
        self.state.library.enable_object_caching()
