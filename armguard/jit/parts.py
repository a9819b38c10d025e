"""What only kernels call: part of the machine code of what Python calls, and nothing by itself.

Numba optimises each function together with all that it calls and makes machine code of the whole,
for each function anew. In a chain of twelve that is done twelve times with what the last one does,
and eleven times for nothing. A part stops before: it is linked into its callers as it was written,
and optimised and translated once, within each entry.

Parts are made by replacing one step of Numba's compiler and the kind of library that it fills.
"""

from __future__ import annotations

from typing import Any

from numba.core import codegen as numba_codegen
from numba.core import compiler as numba_compiler
from numba.core import compiler_machinery as numba_machinery
from numba.core import typed_passes as numba_passes
from numba.core.environment import lookup_environment as numba_lookup_environment

# Numba's functions are untyped: they are called as anything is.
codegen: Any = numba_codegen
compiler: Any = numba_compiler
machinery: Any = numba_machinery
passes: Any = numba_passes
lookup_environment: Any = numba_lookup_environment


class PartLibrary(codegen.JITCodeLibrary):  # type: ignore[misc]  # a class of unknown type
    """Code that waits to be linked into another library."""

    def _optimize_final_module(self) -> None:
        """Leave it to the library that this is linked into."""

    def _finalize_final_module(self) -> None:
        """Check that nothing is missing, and make no machine code."""
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Null: there is no machine code."""
        return 0

    def serialize_using_object_code(self) -> Any:
        """For the cache: nothing but the code that is linked."""
        return self.serialize_using_bitcode()

    @classmethod
    def unserialize(cls, context: Any, state: Any) -> Any:
        """The library that was serialized, for a target's context."""
        name, _, code = state
        library = cls(context.codegen(), name)
        library._final_module = codegen.ll.parse_bitcode(code)
        library._finalize_final_module()
        return library

    @property
    def codegen(self) -> Any:
        """What environments of functions are entered in; see `set_env`."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: an environment is entered in machine code, by `EnterEnvironments`."""


class PartContext:
    """A target's context under which libraries that are read from a cache become parts.

    Args:
        context: The target's own.
    """

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def codegen(self) -> Any:
        """What reads libraries: this."""
        return self

    def unserialize_library(self, state: Any) -> Any:
        """The part that was serialized."""
        return PartLibrary.unserialize(self._context, state)


@machinery.register_pass(mutates_CFG=True, analysis_only=False)
class UsePartLibrary(machinery.LoweringPass):  # type: ignore[misc]  # a class of unknown type
    """Have a function's code put in a `PartLibrary`."""

    _name = "armguard_use_part_library"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Provide the library; nothing else changes."""
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return False


@machinery.register_pass(mutates_CFG=True, analysis_only=False)
class EnterEnvironments(machinery.LoweringPass):  # type: ignore[misc]  # a class of unknown type
    """Enter the environments of all parts in an entry's machine code, as Numba's cache does."""

    _name = "armguard_enter_environments"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Enter them; nothing else changes."""
        for variable in state.library._final_module.global_variables:
            environment = lookup_environment(variable.name)
            if environment is not None:
                state.library.codegen.set_env(variable.name, environment)
        return False


class PartCompiler(compiler.CompilerBase):  # type: ignore[misc]  # a class of unknown type
    """Compiles parts."""

    def define_pipelines(self) -> list[Any]:
        """Numba's own, but for the library."""
        steps = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        steps.add_pass_after(UsePartLibrary, passes.AnnotateTypes)
        steps.finalize()
        return [steps]


class EntryCompiler(compiler.CompilerBase):  # type: ignore[misc]  # a class of unknown type
    """Compiles entries."""

    def define_pipelines(self) -> list[Any]:
        """Numba's own, and what parts need."""
        steps = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        steps.add_pass_after(EnterEnvironments, passes.NoPythonBackend)
        steps.finalize()
        return [steps]
