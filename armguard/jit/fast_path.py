"""Compiles kernels with private parts of Numba: the same machine code in less than half the time.

`kernels` uses this module with versions of Numba that it was tested with, and no other module of
armguard touches these parts. What kernels compute is the same to the bit without it.

Numba optimises each function together with all that it calls and makes machine code of the whole,
for each function anew. In a chain of twelve that is done twelve times with what the last one does,
and eleven times for nothing. Here, what Python calls is an *entry*, which is compiled as a whole.
What only kernels call is a *part*: linked into entries as it was written, and optimised and
translated there. What is long and within many entries is a *separate kernel*: it is compiled once,
and its callers know its symbol alone.

Beside that the signatures of operators are remembered, items of arrays are addressed at once, and
compiled code is kept in files of armguard's own.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import operator
import os
import pickle
import sys
import types as python_types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm_binding
import numba
from numba import extending as numba_extending
from numba import types as numba_types
from numba.core import cgutils as numba_cgutils
from numba.core import codegen as numba_codegen
from numba.core import compiler as numba_compiler
from numba.core import compiler_lock as numba_compiler_lock
from numba.core import compiler_machinery as numba_machinery
from numba.core import environment as numba_environment
from numba.core import ir as numba_ir
from numba.core import lowering as numba_lowering
from numba.core import serialize as numba_serialize
from numba.core import typed_passes as numba_passes
from numba.core import typing as numba_typing
from numba.core import untyped_passes as numba_untyped_passes
from numba.core.runtime import context as numba_runtime
from numba.cpython import builtins as numba_builtins
from numba.np import arrayobj as numba_arrayobj

from armguard.jit import carried
from armguard.jit.compile_lock import hold_compile_lock
from armguard.jit.handle import HandleType
from armguard.jit.kernel_folder import find_cache
from armguard.jit.progress import follow

# Numba's functions are untyped: they are called as anything is.
arrayobj: Any = numba_arrayobj
builtins: Any = numba_builtins
cgutils: Any = numba_cgutils
codegen: Any = numba_codegen
compiler: Any = numba_compiler
compiler_lock: Any = numba_compiler_lock
extending: Any = numba_extending
environment: Any = numba_environment
ir: Any = numba_ir
llvm: Any = llvm_binding
lowering: Any = numba_lowering
machinery: Any = numba_machinery
njit: Any = numba.njit
passes: Any = numba_passes
runtime: Any = numba_runtime
serialize: Any = numba_serialize
types: Any = numba_types
typing: Any = numba_typing
untyped_passes: Any = numba_untyped_passes

# Operators
#
# Numba tries all that an operator could mean, on strings, lists and sets as well, each time that it
# meets one, and once more when it writes code for it. Kernels add, multiply and index the same few
# kinds of numbers and arrays thousands of times.


class KnownOperator(types.Function):  # type: ignore[misc]  # a class of unknown type
    """An operator that remembers its signature for each kind of operands.

    Args:
        function: Numba's type of the operator.
    """

    def __new__(cls, function: Any) -> Any:
        """A copy, which shares what Numba notes for each signature when it writes code."""
        known: Any = object.__new__(cls)
        known.__dict__ = vars(function) | {"signatures": {}}
        return known

    def __init__(self, function: Any) -> None:
        pass

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Signature for arguments of these types."""
        kinds = tuple(args)
        if kws or not all(map(_is_plain, kinds)):
            return super().get_call_type(context, args, kws)
        if kinds not in self.signatures:
            self.signatures[kinds] = super().get_call_type(context, args, kws)
        return self.signatures[kinds]


extending.register_model(KnownOperator)(extending.models.OpaqueModel)


def _is_plain(kind: Any) -> bool:
    """Whether a type is that of numbers, of arrays, or of tuples of these, and will not change."""
    if isinstance(kind, types.BaseTuple):
        return all(map(_is_plain, kind))
    return isinstance(kind, types.Number | types.Boolean | types.Array) and kind.is_precise()


def _find_comparison(function: Any, args: Any) -> Any:
    """What says of two numbers that the later one is nearer to an extreme; None: another call."""
    are_numbers = len(args) > 1 and all(isinstance(kind, types.Number) for kind in args)
    return EXTREMES.get(getattr(function, "typing_key", None)) if are_numbers else None


EXTREMES: dict[Any, Any] = {min: operator.lt, max: operator.gt}


class OperatorTypes:
    """Numba's context of type inference, with operators that remember.

    Args:
        context: Numba's own.
    """

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_value_type(self, value: Any) -> Any:
        """Numba's type of a value; Numba asks for that of an operator wherever it is used."""
        if isinstance(value, BUILT_IN):
            return _find_operator(self._context, value)
        return self._context.resolve_value_type(value)

    def resolve_function_type(self, function: Any, args: Any, kws: Any) -> Any:
        """Signature of a function for arguments of these types; None: there is none."""
        if not kws and _find_comparison(function, args):
            kinds = tuple(map(types.unliteral, args))
            return typing.signature(self._context.unify_types(*kinds), *kinds)
        if isinstance(function, KnownOperator):
            return function.get_call_type(self._context, args, kws)
        return self._context.resolve_function_type(function, args, kws)

    def resolve_setitem(self, target: Any, index: Any, value: Any) -> Any:
        """Signature of setting an item of a target to a value."""
        setitem = self.resolve_value_type(operator.setitem)
        return setitem.get_call_type(self._context, (target, index, value), {})


BUILT_IN = python_types.BuiltinFunctionType | type
"""What an operator or another function that is built into Python can be."""


@functools.cache
def _find_operator(context: Any, function: Any) -> Any:
    """Numba's type of such a function; it remembers its signatures."""
    found = context.resolve_value_type(function)
    return type.__call__(KnownOperator, found) if isinstance(found, types.Function) else found


# Code


class Owners(runtime.NRTContext):  # type: ignore[misc]  # a class of unknown type
    """Finds what counts the references to an array, and reads nothing else of it."""

    def get_meminfos(self, builder: Any, kind: Any, value: Any) -> Any:
        """Type and owner of all that a value consists of and references are counted to."""
        if isinstance(kind, types.Array):
            place = self._context.data_model_manager[kind].get_field_position("meminfo")
            return [(kind, builder.extract_value(value, place))]
        return super().get_meminfos(builder, kind, value)


class Lower(lowering.Lower):  # type: ignore[misc]  # a class of unknown type
    """Writes the code of one function as Numba does, and the address of an item at once.

    Numba copies what describes an array to memory to read one number of it. LLVM takes that out
    again.
    """

    def init(self) -> None:
        """Called at the end of the constructor."""
        super().init()
        # The context is a copy, for this function alone.
        self.context.typing_context = OperatorTypes(self.context.typing_context)
        self.context.nrt = Owners(self.context, self.context.enable_nrt)
        self._borrowed: set[str] = set()

    def lower_assign(self, resty: Any, inst: Any) -> Any:
        """Write an assignment."""
        value = inst.value
        is_field = isinstance(value, ir.Expr) and value.op == "getattr"
        if is_field and isinstance(self.typeof(value.value.name), HandleType):
            self._borrowed.add(inst.target.name)
        return super().lower_assign(resty, inst)

    def delvar(self, name: str) -> None:
        """Write what follows the last use of a variable: nothing, if a handle lent its value."""
        if not (name in self._borrowed and name in self._blk_local_varmap):
            super().delvar(name)

    def _lower_call_normal(self, fnty: Any, expr: Any, signature: Any) -> Any:
        """Write a call; that of an extreme of numbers as Numba does, but no function for it."""
        compare = _find_comparison(fnty, signature.args)
        if compare is None:
            return super()._lower_call_normal(fnty, expr, signature)
        values = self.fold_call_args(fnty, signature, expr.args, expr.vararg, expr.kws)
        return builtins.do_minmax(self.context, self.builder, signature.args, values, compare)

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        """Write how an item is read."""
        kind, index_kind = signature.args
        if not _is_single(kind, index_kind):
            return super().lower_getitem(resty, expr, value, index, signature)
        place = self._find_item(value, kind, index, index_kind)
        item = arrayobj.load_item(self.context, self.builder, kind, place)
        return self.context.cast(self.builder, item, signature.return_type, resty)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        """Write how an item is set."""
        kind, index_kind, given = signature.args
        if not (_is_single(kind, index_kind) and isinstance(given, NUMBERS)):
            return super().lower_setitem(target_var, index_var, value_var, signature)
        value = self.context.cast(self.builder, self._load(value_var, given), given, kind.dtype)
        place = self._find_item(target_var, kind, index_var, index_kind)
        return arrayobj.store_item(self.context, self.builder, kind, value, place)

    def _find_item(self, array: Any, kind: Any, index: Any, index_kind: Any) -> Any:
        """Address of one item; a negative index counts from the end.

        Args:
            array: Variable that holds the array.
            kind: As which it is read.
            index: Variable that holds an integer, or one for each axis.
            index_kind: As which it is read.
        """
        builder, fields = self.builder, self.context.data_model_manager[kind]
        loaded, indices = self._load(array, kind), [self._load(index, index_kind)]
        if isinstance(index_kind, types.BaseTuple):
            indices = cgutils.unpack_tuple(builder, indices[0], index_kind.count)
        data, shape, strides = (
            builder.extract_value(loaded, fields.get_field_position(name))
            for name in ("data", "shape", "strides")
        )
        return cgutils.get_item_pointer2(
            self.context,
            builder,
            data,
            cgutils.unpack_tuple(builder, shape, kind.ndim),
            cgutils.unpack_tuple(builder, strides, kind.ndim),
            kind.layout,
            indices,
            wraparound=True,
            boundscheck=self.context.enable_boundscheck,
        )

    def _load(self, variable: Any, kind: Any) -> Any:
        """A variable's value, as one of this type."""
        value = self.loadvar(variable.name)
        return self.context.cast(self.builder, value, self.typeof(variable.name), kind)


NUMBERS = types.Number, types.Boolean
"""What an item can be whose address is written at once."""


def _is_single(kind: Any, index: Any) -> bool:
    """Whether an index of this type names one number of an array of this type."""
    indices = index.types if isinstance(index, types.BaseTuple) else (index,)
    return (
        isinstance(kind, types.Array)
        and isinstance(kind.dtype, NUMBERS)
        and len(indices) == kind.ndim > 0
        and all(one == types.int64 for one in indices)
    )


@machinery.register_pass(mutates_CFG=True, analysis_only=False)
class WriteCode(passes.NativeLowering):  # type: ignore[misc]  # a class of unknown type
    """Numba's step that writes code, by `Lower`."""

    _name = "armguard_write_code"
    lowering_class = Lower


# Entries and parts


class EntryLibrary(codegen.JITCodeLibrary):  # type: ignore[misc]  # a class of unknown type
    """Machine code that Python calls, or that other machine code calls by its symbol."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.enable_object_caching()

    def _verify_declare_only_symbols(self) -> None:
        """Check that all called code exists: to call a symbol without code ends the process.

        Raises:
            LookupError: It does not.
        """
        super()._verify_declare_only_symbols()
        for function in self._final_module.functions:
            name = function.name
            is_called = function.is_declaration and name.startswith("_ZN")
            if is_called and not self._codegen._engine.is_symbol_defined(name):
                raise LookupError(f"{self.name} calls {name}, which has no machine code")

    def _finalize_final_module(self) -> None:
        """Make machine code, and enter the environments of all parts as Numba's cache does."""
        super()._finalize_final_module()
        for variable in self._final_module.global_variables:
            found = environment.lookup_environment(variable.name)
            if found is not None:
                self._codegen.set_env(variable.name, found)

    def serialize_using_object_code(self) -> Any:
        """For the cache: the machine code, and the names of what is in it.

        Numba would add the code that it was made of, for others to link. Nothing links an entry.
        """
        names = [one.name for one in self.get_defined_functions()]
        empty = (f'define void @"{name}"() {{ ret void }}' for name in names)
        named = llvm.parse_assembly("\n".join(empty))
        return self.name, "object", (self._get_compiled_object(), named.as_bitcode())


class PartLibrary(codegen.JITCodeLibrary):  # type: ignore[misc]  # a class of unknown type
    """Code that waits to be linked into an entry."""

    def _optimize_final_module(self) -> None:
        """Leave it to the entry."""

    def _finalize_final_module(self) -> None:
        """Make no machine code."""
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Null: there is no machine code. Numba asks when a function is complete."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """What environments of functions are entered in; see `set_env`."""
        return self

    def set_env(self, _: str, __: Any) -> None:
        """Do nothing: an entry enters them in its machine code."""


class EntryCompiler(compiler.CompilerBase):  # type: ignore[misc]  # a class of unknown type
    """Compiles entries and separate kernels."""

    library: Any = EntryLibrary

    def define_pipelines(self) -> list[Any]:
        """Numba's own steps, with operators that remember, into a library of this kind."""
        state = self.state
        state.typingctx = OperatorTypes(state.typingctx)
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        steps = compiler.DefaultPassBuilder.define_nopython_pipeline(state)
        steps.passes = [
            (WriteCode if step is passes.NativeLowering else step, title)
            for step, title in steps.passes
            if step not in NEEDLESS
        ]
        steps.finalize()
        return [steps]


class PartCompiler(EntryCompiler):
    """Compiles parts."""

    library = PartLibrary


NEEDLESS = (
    untyped_passes.InlineClosureLikes,
    passes.NopythonRewrites,
    passes.InlineOverloads,
    passes.AnnotateTypes,
)
"""Steps for what no kernel has, functions within functions, sums of whole arrays and Numba's own
functions that it writes out, which are right without but slow; and a listing of all types for
readers. Together they take a twentieth of the time."""


# Files


class KeptKernel:
    """A kernel's machine code in files, one for each kind of arguments; Numba's dispatcher asks it.

    What this process cannot read is as if it were not there: it may be damaged, or be made for
    types of a script that is gone. A folder need not be writable, and a disk may be full. What has
    no file may be among the kernels that a wheel carries.

    Args:
        function: The kernel's.
        within: Folder within that of the module.
    """

    def __init__(self, function: Any, within: str) -> None:
        module = find_cache(Path(function.__code__.co_filename))
        self._name = f"{function.__name__}-{function.__code__.co_firstlineno}"
        self._folder, self._carried = module / within, carried.CARRIED / module.name / within
        self.cache_path = str(self._folder)
        self.lock = self._folder / f"{self._name}.lock"

    def load_overload(self, kinds: Any, context: Any) -> Any:
        """What was compiled for arguments of these types; None: it is not there."""
        context.refresh()
        for path in self._list_paths(kinds, context):
            # Not there, damaged or calling what is no longer there: anything can be raised.
            with contextlib.suppress(Exception):
                state = pickle.loads(path.read_bytes())
                found = compiler.CompileResult._rebuild(context, *state)
                if found.signature.args == kinds:
                    return found
        return None

    def save_overload(self, kinds: Any, result: Any) -> None:
        """Keep what was compiled for arguments of these types, if possible."""
        if result.library.has_dynamic_globals:  # addresses of this process
            return
        path = next(self._list_paths(kinds, result.target_context))
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            unfinished = path.with_suffix(f".{os.getpid()}")
            try:
                unfinished.write_bytes(serialize.dumps(result._reduce()))
                unfinished.replace(path)
            finally:
                unfinished.unlink(missing_ok=True)

    def _list_paths(self, kinds: Any, context: Any) -> Iterator[Path]:
        """The file for arguments of these types, and the one that a wheel may carry."""
        yield self._folder / self._make_filename(kinds, context.codegen().magic_tuple())
        target = find_carried_target()
        if target is not None:
            yield self._carried / self._make_filename(kinds, target)

    def _make_filename(self, kinds: Any, target: tuple[str, ...]) -> str:
        python = sys.implementation.cache_tag, sys.abiflags
        made_for = repr((numba.__version__, *python, target, kinds))
        return f"{self._name}.{hashlib.sha256(made_for.encode()).hexdigest()[:16]}.kernel"


@functools.cache
def find_carried_target() -> tuple[str, str, str] | None:
    """What carried kernels were made for, if this processor runs that; None: they do not fit.

    Like Numba's code generator: LLVM's name of architecture and operating system, its name of the
    processor, and features.
    """
    triple = llvm.get_process_triple()
    if not (carried.CARRIED.is_dir() and triple.startswith("x86_64")):
        return None
    try:
        features = llvm.get_host_cpu_features()
    except RuntimeError:  # LLVM does not know
        return None
    has_all = all(features.get(name, False) for name in carried.NEEDED)
    return (triple, carried.PROCESSOR, "") if has_all else None


# Kernels


def make_entry(function: Any, options: dict[str, Any]) -> Any:
    """A kernel that is a part of other kernels which call it.

    Args:
        function: What to compile.
        options: Further options of `numba.njit`.
    """

    @functools.cache
    def make_part() -> Any:
        # What C or Python would call a part by takes as long to compile as a short kernel.
        return _make_dispatcher(function, PartCompiler, no_cpython_wrapper=True, **options)

    return _divert(_make_dispatcher(function, EntryCompiler, "", **options), make_part)


def make_separate_entry(function: Any) -> Any:
    """A kernel of which other kernels call the machine code, made once for all of them.

    Args:
        function: What to compile. What Python calls is compiled by itself, as of any kernel.
    """

    @functools.cache
    def make_callee() -> Any:
        compiled = _make_dispatcher(function, EntryCompiler, "callees", no_cpython_wrapper=True)
        enter = compiled.add_overload

        def add_overload(result: Any) -> None:
            kinds, symbol = tuple(result.signature.args), result.fndesc.llvm_func_name
            # Nothing of it is linked into callers. They load it before they are loaded themselves.
            empty = result.library.codegen._create_empty_module(result.library.name)
            result.library._shared_module = llvm.parse_assembly(str(empty))
            callee = Callee(function.__module__, function.__qualname__, kinds, symbol)
            result.library._reload_init = {callee}
            enter(result)

        compiled.add_overload = add_overload
        return compiled

    _callees[function.__module__, function.__qualname__] = make_callee
    return _divert(_make_dispatcher(function, EntryCompiler, ""), make_callee)


_callees: dict[tuple[str, str], Callable[[], Any]] = {}
"""By module and name: what compiles each separate kernel for those that call it."""


class Callee(NamedTuple):
    """Machine code that other machine code calls by its symbol.

    Numba calls this before it loads what calls it: to call a symbol that is not there ends the
    process.
    """

    module: str
    """Of the kernel, which whatever calls it has imported."""
    name: str
    """The kernel's own."""
    kinds: tuple[Any, ...]
    """Numba's types of its arguments."""
    symbol: str
    """The name of its machine code."""

    def __call__(self) -> None:
        """Load it, or compile it.

        Raises:
            LookupError: It is not there, or has another symbol by now, so that the caller must be
                compiled anew.
        """
        callee = _callees[self.module, self.name]()
        callee.compile(self.kinds)
        symbol = callee.overloads[self.kinds].fndesc.llvm_func_name
        if symbol != self.symbol:
            raise LookupError(f"{self.name} is at {symbol}; expected {self.symbol}")


def _divert(compiled: Any, make_inner: Callable[[], Any]) -> Any:
    """Have kernels that call an entry use something else, which is made when it is needed first.

    Args:
        compiled: What Python calls.
        make_inner: Makes what other kernels call.
    """

    def find_inner(kinds: tuple[Any, ...], names: dict[str, Any]) -> Any:
        # A constant is a number like any other, and needs no code of its own.
        plain = {name: types.unliteral(kind) for name, kind in names.items()}
        return make_inner().get_call_template(tuple(map(types.unliteral, kinds)), plain)

    compiled.get_call_template = find_inner
    compiled.get_overload = lambda kinds: make_inner().get_overload(kinds)
    return compiled


def _make_dispatcher(
    function: Any, compiler: Any, within: str | None = None, **options: Any
) -> Any:
    """What compiles a function for each kind of arguments that it is called with.

    Args:
        function: What to compile.
        compiler: Class of the compiler.
        within: Folder of what is kept, within that of the module; None: nothing is kept.
        options: Further options of `numba.njit`.
    """
    compiled = njit(
        error_model="numpy", pipeline_class=compiler, no_cfunc_wrapper=True, **options
    )(function)  # fmt: skip
    if within is not None:
        kept = compiled._cache = KeptKernel(function, within)
        compile_at_once = compiled.compile

        def compile_alone(kinds: Any) -> Any:
            # Numba's lock first: then no thread waits for a file that another one has locked.
            with compiler_lock.global_compiler_lock, hold_compile_lock(kept.lock):
                return compile_at_once(kinds)

        compiled.compile = compile_alone
    follow(compiled)
    return compiled
