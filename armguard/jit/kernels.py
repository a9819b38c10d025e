"""Compiled kernels, cached on disk under all the sources that they were made from.

Numba renews a cached kernel when the kernel's own file changes, and by time stamp and size only. A
kernel also contains the kernels and constants of other files that it uses, and files of a wheel all
have one time stamp: a monitor must not run yesterday's bounds because of that. So every module's
kernels are kept under a digest of its source and of all of armguard's sources that it imports.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numba
from numba import types as numba_types
from numba.core import caching as numba_caching
from numba.core import compiler_lock as numba_compiler_lock
from numba.core import event as numba_event

from armguard.jit.carried import find_target, open_carried
from armguard.jit.collection import CollectionPause
from armguard.jit.compile_lock import hold_compile_lock
from armguard.jit.parts import EntryCompiler, PartCompiler, PartContext, link_by_symbol

# Numba's functions are untyped: they are called as anything is.
caching: Any = numba_caching
compiler_lock: Any = numba_compiler_lock
config: Any = numba.config
event: Any = numba_event
njit: Any = numba.njit
types: Any = numba_types

event.register("numba:compile", CollectionPause())

PACKAGE = Path(__file__).resolve().parents[1]


OLDEST_TRIED, NEWEST_TRIED = (0, 63), (0, 68)
"""Versions of Numba with which kernels were read from caches; others compile at each start."""

STAMP = ""
"""Instead of the time and size of a source."""


class KernelFolder(caching.UserProvidedCacheLocator):  # type: ignore[misc]  # of unknown type
    """Where a module's kernels are kept: in the folder of `find_cache`, and nowhere else.

    Where Numba cannot write, it looks for another folder, and knows a kernel there by its own file
    alone. Here no stamp is needed beside the folder's name, which says what they were made from.
    """

    part = Path()
    """Within that folder."""

    def __init__(self, function: Any, file: str) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._cache_path = str(find_cache(Path(file)) / self.part)

    @classmethod
    def from_function(cls, function: Any, file: str) -> Any:
        """Where the kernel of a function in a file is kept."""
        return cls(function, file)

    def get_source_stamp(self) -> str:
        """The same for all."""
        return STAMP


class PartFolder(KernelFolder):
    """Where its parts are kept."""

    part = Path("parts")


class CalleeFolder(KernelFolder):
    """Where its separate kernels are kept, as other kernels call them."""

    part = Path("callees")


class KeptKernel(caching.CompileResultCacheImpl):  # type: ignore[misc]  # a class of unknown type
    """How a kernel is kept."""

    _locator_classes = (KernelFolder,)


class KeptPart(caching.CompileResultCacheImpl):  # type: ignore[misc]  # a class of unknown type
    """How a part is kept."""

    _locator_classes = (PartFolder,)

    def rebuild(self, context: Any, state: Any) -> Any:
        """What the cache was given, as a part again."""
        result = super().rebuild(PartContext(context), state)._replace(target_context=context)
        # Which Numba does not restore: what this is linked into calls the same separate kernels.
        result.library._reload_init.update(result.reload_init)
        return result


class KeptCallee(KeptKernel):
    """How a separate kernel is kept."""

    _locator_classes = (CalleeFolder,)


class TolerantCache(caching.FunctionCache):  # type: ignore[misc]  # a class of unknown type
    """A cache that begins anew where it holds what this process cannot read, and need not be there.

    Its index names all types that a kernel was ever compiled for, and so those of a script that was
    run from elsewhere: to a later process, that must be no more than a cache without an entry. A
    disk may be full, or a file cut short. What it does not have may be among the carried kernels.
    """

    _impl_class = KeptKernel

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        caches = find_cache(Path(function.__code__.co_filename)).parent
        folder = Path(self.cache_path).relative_to(caches)
        self._carried = open_carried(folder, self._impl.filename_base, STAMP)

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            found = super()._load_overload(sig, target_context)
        except Exception:  # a damaged file can raise anything
            with contextlib.suppress(OSError):
                self._cache_file.flush()
            found = None
        return self._load_carried(sig, target_context) if found is None else found

    def _load_carried(self, sig: Any, target_context: Any) -> Any:
        target = find_target()
        if target is None:
            return None
        try:
            data = self._carried.load(self._index_key(sig, target))
            return None if data is None else self._impl.rebuild(target_context, data)
        except Exception:  # as above; it is left as it is, being another's
            return None

    def _save_overload(self, sig: Any, data: Any) -> None:
        with contextlib.suppress(OSError):
            super()._save_overload(sig, data)


class PartCache(TolerantCache):
    """The same for parts."""

    _impl_class = KeptPart


class CalleeCache(TolerantCache):
    """The same for separate kernels."""

    _impl_class = KeptCallee


def kernel(function: Any = None, **options: Any) -> Any:
    """Compile a function with NumPy's error model and strict floating point, and cache it.

    What is returned is called from Python. Other kernels that call it are given a part, see
    `parts`: both are compiled when they are called first, for each kind of arguments.

    Args:
        function: What to compile.
        options: Those of `numba.njit` for how it is inlined. Kernels are serial: `parallel` rests
            on steps of Numba's compiler that are left out here.
    """

    def compile_function(function: Any) -> Any:
        @functools.cache
        def make_part() -> Any:
            # What C or Python would call a part by takes as long to compile as a short kernel.
            bare = {"no_cpython_wrapper": True, **options}
            return _make_dispatcher(function, PartCache(function), PartCompiler, bare)

        return _make_entry(function, make_part, options)

    return compile_function if function is None else compile_function(function)


def merged_kernel(function: Any) -> Any:
    """A kernel whose machine code becomes part of that of each kernel that calls it.

    For what a loop over rows calls for each of them: to hand over a few groups of arrays, seven
    words each, takes longer than what is done with one row of them.

    Args:
        function: What to compile.
    """
    return kernel(function, forceinline=True)


def separate_kernel(function: Any) -> Any:
    """A kernel of which other kernels call the machine code, made once for all of them.

    For what is long and called by several entries: as a part it would be optimised and translated
    within each. Its callers' code knows its symbol alone, and a call costs what one of a part does
    that was too long to be merged. What Python calls is compiled by itself, as of any kernel.

    Args:
        function: What to compile.
    """

    @functools.cache
    def make_callee() -> Any:
        bare = {"no_cpython_wrapper": True}
        compiled = _make_dispatcher(function, CalleeCache(function), EntryCompiler, bare)
        enter = compiled.add_overload

        def add_overload(result: Any) -> None:
            kinds, symbol = tuple(result.signature.args), result.fndesc.llvm_func_name
            callee = Callee(function.__module__, function.__qualname__, kinds, symbol)
            link_by_symbol(result.library, callee)
            enter(result)

        compiled.add_overload = add_overload
        return compiled

    _callees[function.__module__, function.__qualname__] = make_callee
    return _make_entry(function, make_callee, {})


_callees: dict[tuple[str, str], Callable[[], Any]] = {}
"""By module and name: what compiles each separate kernel for those that call it."""


class Callee(NamedTuple):
    """Machine code that other machine code calls by its symbol.

    Numba's cache calls this before it loads what calls it: to call a symbol that is not there ends
    the process.
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


def _make_entry(function: Any, make_part: Callable[[], Any], options: dict[str, Any]) -> Any:
    """What Python calls of a kernel.

    Args:
        function: What to compile.
        make_part: Makes what compiles it for kernels that call it.
        options: Further options of `numba.njit`.
    """
    compiled = _make_dispatcher(function, TolerantCache(function), EntryCompiler, options)

    def find_part(kinds: tuple[Any, ...], names: dict[str, Any]) -> Any:
        # A constant is a number like any other, and needs no part of its own.
        plain = {name: types.unliteral(kind) for name, kind in names.items()}
        return make_part().get_call_template(tuple(map(types.unliteral, kinds)), plain)

    # Where all kernels are read from the cache, none is called by another one.
    compiled.get_call_template = find_part
    compiled.get_overload = lambda kinds: make_part().get_overload(kinds)
    return compiled


def _make_dispatcher(function: Any, cache: Any, compiler: Any, options: dict[str, Any]) -> Any:
    """What compiles a function for each kind of arguments that it is called with.

    Args:
        function: What to compile.
        cache: Keeps what was compiled.
        compiler: Class of the compiler.
        options: Further options of `numba.njit`.
    """
    # Python's error model costs two to four times as much, and fastmath would drop NaN.
    compiled = njit(
        error_model="numpy", pipeline_class=compiler, no_cfunc_wrapper=True, **options
    )(function)  # fmt: skip
    compiled._cache = cache
    compile_at_once = compiled.compile

    def compile_alone(kinds: Any) -> Any:
        if isinstance(kinds, tuple) and kinds in compiled.overloads:
            return compiled.overloads[kinds].entry_point
        # Numba's lock first: then no thread waits for a file that another one has locked.
        with compiler_lock.global_compiler_lock, hold_compile_lock(lock):
            return compile_at_once(kinds)

    lock = Path(cache.cache_path) / f"{function.__name__}-{function.__code__.co_firstlineno}.lock"
    compiled.compile = compile_alone
    return compiled


def is_tried(version: str) -> bool:
    """Whether kernels were read from caches by this version of Numba.

    How a cache is made is no public interface of Numba: 0.62 aborts the process where kernels of
    this package come from one.
    """
    numbers = tuple(int(part) for part in re.findall(r"\d+", version)[:2])
    return OLDEST_TRIED <= numbers <= NEWEST_TRIED


@functools.cache
def find_private_folder() -> Path:
    """Where a process keeps its kernels that no other one is to read; gone at its end."""
    folder = tempfile.TemporaryDirectory(prefix="armguard-kernels-", ignore_cleanup_errors=True)
    atexit.register(folder.cleanup)
    return Path(folder.name)


@functools.cache
def find_cache(source: Path) -> Path:
    """The folder for one module's kernels; those of its older versions beside it are removed.

    Args:
        source: The module's file.
    """
    if not is_tried(numba.__version__):
        return find_private_folder() / f"{source.parent.name}-{source.stem}"
    name = f"kernels-{source.parent.name}-{source.stem}-"
    place = name + digest_sources(source, PACKAGE, _seen)
    if config.CACHE_DIR:  # by the user, as NUMBA_CACHE_DIR
        return Path(config.CACHE_DIR) / place
    beside = PACKAGE / "__pycache__"
    if not os.access(beside if beside.exists() else PACKAGE, os.W_OK):
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        return caches / "armguard" / place
    for old in beside.glob(f"{name}*"):
        if old.name != place:
            shutil.rmtree(old, ignore_errors=True)
    return beside / place


Source = tuple[bytes, tuple[str, ...]]
"""Digest of a source, and what it imports of the package."""

_seen: dict[str, Source] = {}
"""Sources of this process's kernels; most count for dozens of modules, and are read once."""


def digest_sources(source: Path, package: Path, seen: dict[str, Source] | None = None) -> str:
    """A digest of a module's source and of all sources of its package that it imports.

    What compiles kernels and reads their handles counts with each, imported or not.

    Args:
        source: The module's file.
        package: The folder of the package `armguard`.
        seen: Sources that were read before; those that are read now are added.
    """
    seen = {} if seen is None else seen
    sources: set[str] = set()
    root = str(package)
    waiting = [str(source), *map(str, (package / "jit").glob("*.py"))]
    while waiting:
        path = waiting.pop()
        if path not in sources:
            sources.add(path)
            if path not in seen:
                content = Path(path).read_bytes()
                seen[path] = (
                    hashlib.sha256(content).digest(),
                    find_imported(path, content, root),
                )
            waiting.extend(seen[path][1])
    digest = hashlib.sha256()
    for path in sorted(sources):
        digest.update(seen[path][0])
    return digest.hexdigest()[:16]


WORD = re.compile(r"\w+")

IMPORT = re.compile(r"import\b([\w., \t\f]*)")
"""An import of modules; their names."""

IMPORT_FROM = re.compile(
    r"from\b([ \t\f.]*)([\w. \t\f]*?)\bimport\b"
    r"(?=[ \t\f]*(?:\(((?:[^)#]|#.*)*)|([\w, \t\f]*)))"
)
"""An import from a module: dots, module, and what is taken, in brackets or not."""


def find_imported(source: str, content: bytes, package: str) -> tuple[str, ...]:
    """Files of the package that a module's imports could take anything from.

    A name that is taken from a package can be the package's own or one of its modules, so both
    count. The packages around a module, which Python imports along with it, do not: nothing of
    them gets into a kernel unless it is named.

    All that looks like an import counts, in a string as well: a source too many does no harm, and
    to parse all sources would take a third of a start's time. Paths are strings, because thousands
    of them as objects would take a tenth.

    Args:
        source: The module's file.
        content: What stands in it.
        package: The folder of the package `armguard`.
    """
    join = os.path.join
    text = re.sub(r"\\\r?\n", " ", content.decode(errors="replace"))
    modules: list[str] = []
    for names in IMPORT.findall(text):
        for name, *parts in filter(None, map(WORD.findall, names.split(","))):
            if name == "armguard":
                # An import of armguard.a.b makes armguard and armguard.a accessible as well.
                modules += [join(package, *parts[:k]) for k in range(len(parts) + 1)]
    for dots, module, within, beside in IMPORT_FROM.findall(text):
        parts = WORD.findall(module)
        if "." in dots:
            place = source
            for _ in range(dots.count(".")):
                place = os.path.dirname(place)
            place = join(place, *parts)
        elif parts[:1] == ["armguard"]:
            place = join(package, *parts[1:])
        else:
            continue
        taken = WORD.findall(re.sub("#.*", "", within)) + WORD.findall(beside)
        modules += [place, *(join(place, name) for name in taken)]
    files = (
        file for one in dict.fromkeys(modules) for file in (f"{one}.py", join(one, "__init__.py"))
    )
    return tuple(filter(os.path.isfile, files))
