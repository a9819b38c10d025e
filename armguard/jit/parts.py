"""What only kernels call: part of the machine code of what Python calls, and nothing by itself.

Numba optimises each function together with all that it calls and makes machine code of the whole,
for each function anew. In a chain of twelve that is done twelve times with what the last one does,
and eleven times for nothing. A part stops before: it is linked into its callers as it was written,
and optimised and translated once, within each entry. What is long and within many entries stays
outside of them instead: it is compiled as an entry is, and they call it by its symbol.

Parts are made by replacing one step of Numba's compiler and the kind of library that it fills. With
it, steps are left out that find nothing in a kernel and look for it for long, and code is written
as `lowering` has it.
"""

from __future__ import annotations

from typing import Any

from numba.core import codegen as numba_codegen
from numba.core import compiler as numba_compiler
from numba.core import compiler_machinery as numba_machinery
from numba.core import typed_passes as numba_passes
from numba.core import untyped_passes as numba_untyped_passes
from numba.core.environment import lookup_environment as numba_lookup_environment

from armguard.jit.lowering import Lower
from armguard.jit.operators import OperatorTypes

# Numba's functions are untyped: they are called as anything is.
codegen: Any = numba_codegen
compiler: Any = numba_compiler
machinery: Any = numba_machinery
passes: Any = numba_passes
untyped_passes: Any = numba_untyped_passes
lookup_environment: Any = numba_lookup_environment


NEEDLESS = (
    untyped_passes.InlineClosureLikes,
    passes.NopythonRewrites,
    passes.InlineOverloads,
    passes.AnnotateTypes,
)
"""Steps for what no kernel has, functions within functions, sums of whole arrays and Numba's own
functions that it writes out, which are right without but slow; and a listing of all types for
readers. Together they take a twentieth of the time."""


class KernelLibrary(codegen.JITCodeLibrary):  # type: ignore[misc]  # a class of unknown type
    """Code of a kernel."""

    def _optimize_functions(self, module: Any) -> None:
        """Optimise each function that a module defines, with passes that are set up once."""
        module.data_layout = self._codegen._data_layout
        manager, builder = self._codegen._function_pass_manager()
        for function in module.functions:
            if not function.is_declaration:
                manager.run(function, builder)


class PartLibrary(KernelLibrary):
    """Code that waits to be linked into another library."""

    def _optimize_final_module(self) -> None:
        """Leave it to the library that this is linked into."""

    def _finalize_final_module(self) -> None:
        """Make no machine code; whether anything is missing is seen where that is made."""
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Null: there is no machine code."""
        # What it calls is asked for next, to be kept along with it; now it is linked.
        self._ensure_finalized()
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


class EntryLibrary(KernelLibrary):
    """Code that Python calls, with all parts that it needs."""

    def _optimize_final_module(self) -> None:
        """Optimise it once.

        Numba does it twice: a first time so that references can be found that cancel out. Of the
        arrays that kernels borrow none is counted.
        """
        manager, builder = self._codegen._module_pass_manager()
        manager.run(self._final_module, builder)

    def _verify_declare_only_symbols(self) -> None:
        """Have all that is called be there: a call of what is not would end the process.

        Raises:
            LookupError: It is not.
        """
        super()._verify_declare_only_symbols()
        for function in self._final_module.functions:
            name = function.name
            is_called = function.is_declaration and name.startswith("_ZN")
            if is_called and not self._codegen._engine.is_symbol_defined(name):
                raise LookupError(f"{self.name} calls {name}, which has no machine code")

    def serialize_using_object_code(self) -> Any:
        """For the cache: the machine code, and the names of what is in it.

        Numba would add the code that it was made of, for others to link. Nothing links an entry.
        """
        self._ensure_finalized()
        names = [one.name for one in self.get_defined_functions()]
        empty = (f'define void @"{name}"() {{ ret void }}' for name in names)
        named = codegen.ll.parse_assembly("\n".join(empty))
        return self.name, "object", (self._get_compiled_object(), named.as_bitcode())


def link_by_symbol(library: Any, load: Any) -> None:
    """Have nothing of a library linked into what calls it, which finds its machine code by symbol.

    Args:
        library: Whose machine code is in memory.
        load: Called, without arguments, before any of these callers is read from a cache; it is
            kept along with them.
    """
    nothing = codegen.ll.parse_assembly(str(library.codegen._create_empty_module(library.name)))
    library._shared_module = nothing
    library._reload_init = {load}


@machinery.register_pass(mutates_CFG=True, analysis_only=False)
class InferTypes(passes.NopythonTypeInference):  # type: ignore[misc]  # a class of unknown type
    """Infer types as Numba does, with operators that are known."""

    _name = "armguard_infer_types"

    def run_pass(self, state: Any) -> bool:
        """Infer types; the context is left as it was."""
        context = state.typingctx
        state.typingctx = OperatorTypes(context, state.flags)
        try:
            changed: bool = super().run_pass(state)
        finally:
            state.typingctx = context
        return changed


@machinery.register_pass(mutates_CFG=True, analysis_only=False)
class WriteCode(passes.NativeLowering):  # type: ignore[misc]  # a class of unknown type
    """Write code as Numba does, with operators that are known."""

    _name = "armguard_write_code"

    @property
    def lowering_class(self) -> Any:
        """What writes it."""
        return Lower


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
class UseEntryLibrary(machinery.LoweringPass):  # type: ignore[misc]  # a class of unknown type
    """Have a function's code put in an `EntryLibrary`."""

    _name = "armguard_use_entry_library"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Provide the library; nothing else changes."""
        state.library = EntryLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        # As Numba does for its own: the machine code is kept for the cache.
        state.library.enable_object_caching()
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


def _define_steps(state: Any) -> Any:
    """Numba's own steps, but for how types are inferred, without those that are needless."""
    steps = compiler.DefaultPassBuilder.define_nopython_pipeline(state)
    instead = {passes.NopythonTypeInference: InferTypes, passes.NativeLowering: WriteCode}
    steps.passes = [
        (instead.get(step, step), title) for step, title in steps.passes if step not in NEEDLESS
    ]
    return steps


class PartCompiler(compiler.CompilerBase):  # type: ignore[misc]  # a class of unknown type
    """Compiles parts."""

    def define_pipelines(self) -> list[Any]:
        """The steps, into a library for parts."""
        steps = _define_steps(self.state)
        steps.add_pass_after(UsePartLibrary, InferTypes)
        steps.finalize()
        return [steps]


class EntryCompiler(compiler.CompilerBase):  # type: ignore[misc]  # a class of unknown type
    """Compiles entries."""

    def define_pipelines(self) -> list[Any]:
        """The steps, into a library for entries, and what parts need."""
        steps = _define_steps(self.state)
        steps.add_pass_after(UseEntryLibrary, InferTypes)
        steps.add_pass_after(EnterEnvironments, passes.NoPythonBackend)
        steps.finalize()
        return [steps]
