"""Functions compiled by Numba, and the types of their arguments; imported only where such functions are used.

The first `FEW` calls of a process run in Python as they are written: so one answer takes 3 ms, and loading Numba with what it
compiled 500. Then each function is compiled when it is first called, with those that it calls, or loaded from the folder where
an earlier process kept it; the numbers are the same bit by bit. A process says once that it compiles. `rbd warm-up` compiles
all ahead; with `RBD_COMPILED=1` in the environment no call runs in Python, and with `RBD_COMPILED=0` all do.
"""

from __future__ import annotations

import hashlib
import os
import selectors
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import cache, update_wrapper
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from rbd.installation import cores, in_use

FEW = 2_500
"""Calls that run in Python, of kernels from kernels too: 20 answers where all sticks, one or two where points slip."""
LARGE = 5_000
"""A call with an array of more entries is compiled."""
NUMBER, COUNT, FLAG = "float64", "int64", "boolean"


class _Array(NamedTuple):
    kind: str
    dim: int
    layout: Literal["C", "A"]
    readonly: bool


def array(dim: int, kind: str = NUMBER, *, written: bool = False, layout: Literal["C", "A"] = "C") -> Any:
    """The type of an array; one that is only read may be read-only."""
    return _Array(kind, dim, layout, not written)


class _Record(NamedTuple):
    kind: type
    fields: tuple[Any, ...]


def record(kind: type, *fields: Any) -> Any:
    """The type of a named tuple with fields of these types."""
    return _Record(kind, fields)


def signature(result: Any, *arguments: Any) -> Any:
    """Of a function of these arguments; a tuple of results is a tuple of types, None for nothing."""
    return result, arguments


def compiled(function: Callable[..., Any], types: Any = None, *, unlocked: bool = False) -> Callable[..., Any]:
    """A function that is compiled after the first calls, and kept on disk; with a signature, compiled for these types alone.

    Without one it becomes a part of those that call it, and called from Python it runs as it is written. Where neither the
    package's folder nor the user's cache can be written, it is compiled anew in each process. One that is `unlocked` lets other
    threads of Python run.
    """
    return Kernel(function, types, {"nogil": unlocked}) if in_use() else np.errstate(all="ignore")(function)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that becomes a part of each kernel that calls it: for a few operations on tuples."""
    return Kernel(function, None, {"forceinline": True}) if in_use() else function


def before_compiling(module: str) -> None:
    """Import a module before anything is compiled: what it teaches Numba."""
    _lessons.append(module)


_lessons: list[str] = []


Bar: TypeAlias = "Callable[[int], AbstractContextManager[Callable[[int], None]]]"


@contextmanager
def _no_bar(count: int) -> Iterator[Callable[[int], None]]:
    yield _nothing


def show_progress(bar: Bar) -> None:
    """Show what compiling has done, where it takes long; by default a line says once that it goes on.

    Args:
        bar: Given the number of functions, a context whose function is told how many are compiled.
    """
    _Process.bar = staticmethod(bar)


class _Process:
    """What this process did.

    Attributes:
        few: Calls that may still run in Python.
        inside: Whether one runs now.
        told: Whether it has said that it compiles.
        shared: Whether it has let other processes compile.
        bar: Shows how much is done: given a count, a context whose function is told how many are.
        compiled: Functions compiled so far, by their names, once for each set of types.
        kept: Whether they are kept on disk.
    """

    few = 0 if os.environ.get("RBD_COMPILED") else FEW
    inside = told = shared = False
    bar: Bar = staticmethod(_no_bar)
    compiled: tuple[str, ...] = ()
    kept = True


class Kernel:
    """A function of numbers and arrays: Python at first, then Numba's."""

    def __init__(self, function: Callable[..., Any], types: Any, options: dict[str, bool]) -> None:
        self.function, self.types, self.options = function, types, options
        self.made: Any = None
        self.ready = False
        update_wrapper(self, function)
        _kernels.append(self)

    def __call__(self, *arguments: Any) -> Any:
        """Its result; one kernel within another that runs in Python does so too, since types of Python's numbers may differ."""
        if _Process.inside:
            _Process.few -= 1
            return self.function(*arguments)
        if not self.ready:
            # With one thread alone, no other calls a kernel while this one runs in Python.
            if _Process.few > 0 and threading.active_count() == 1 and _entries(arguments) <= LARGE:
                return self._interpreted(arguments)
            if self.types is None:
                return self.function(*arguments)
            prepare(self)
        return self.made(*arguments)

    @property
    def _numba_type_(self) -> Any:
        """What one kernel that is compiled sees of another that it calls: Numba's function, compiled first if it has types."""
        if self.types is not None:
            self.compile()
        elif self.made is None:
            self.made = _dispatcher(self)
        return self.made._numba_type_

    def called_with(self, kinds: tuple[Any, ...], named: dict[str, Any]) -> Any:
        """What Numba compiles for arguments of these types: the same for all integers; it would take 0 and 3 for two types."""
        from numba.core.types import unliteral

        plain = {name: unliteral(kind) for name, kind in named.items()}
        return type(self.made).get_call_template(self.made, tuple(map(unliteral, kinds)), plain)

    def compile(self) -> None:
        """Compile it for its types, or load it."""
        if not self.ready:
            self.made = _dispatcher(self)
            result, arguments = self.types
            self.made.compile(_type(result)(*map(_type, arguments)))
            self.made.disable_compile()
            self.ready = True

    def _interpreted(self, arguments: tuple[Any, ...]) -> Any:
        _Process.inside, _Process.few = True, _Process.few - 1
        try:
            with np.errstate(all="ignore"):
                return self.function(*arguments)
        finally:
            _Process.inside = False


_kernels: list[Kernel] = []


def _entries(x: Any) -> int:
    """Of the largest array among some arguments."""
    return max(map(_entries, x), default=0) if isinstance(x, tuple) else int(getattr(x, "size", 0))


def prepare(*which: Callable[..., Any], every: bool = False) -> None:
    """Compile some kernels at once, or load them; if none is named, all that are imported, and all there are if some were new.

    For a loop that must not pause, such as a controller's: call it before.

    Args:
        which: Kernels; others run in Python for their first calls, as before.
        every: Whether to prepare all that the package has in any case.
    """
    if not in_use():
        return
    from numba.core.compiler_lock import global_compiler_lock

    with global_compiler_lock:
        if which:
            _make([kernel for kernel in which if isinstance(kernel, Kernel)])
            return
        compile_from_now_on()
        _make(_kernels)
        if every or _Process.compiled and _Process.kept:
            _import()
            _make(_kernels)


def compile_from_now_on() -> None:
    """Have no more calls run in Python: there will be many."""
    _Process.few = 0


def few_more(calls: int) -> None:
    """Have some more calls run in Python: of a command that is known to need no more, and would end before all is compiled."""
    if _Process.few > 0:
        _Process.few += calls


def _import() -> None:
    for name in modules():
        import_module(name)


def modules() -> list[str]:
    """The package's modules of kernels, by their file names."""
    root = Path(__file__).parent
    files = sorted(root.rglob("*_kernel.py"))
    return [".".join((root.name, *path.relative_to(root).with_suffix("").parts)) for path in files]


def folders() -> list[str]:
    """Where compiled functions are kept; empty where they cannot be."""
    made = [kernel for kernel in _kernels if kernel.ready and _Process.kept]
    return sorted({str(each.made._cache.cache_path) for each in made})


def warm_up() -> tuple[str, ...]:
    """Prepare all, and say nothing; the names of the functions that were compiled, by as many processes as there are cores."""
    _Process.told = True
    n = cores()
    code = "import sys; from rbd import kernels; print(*kernels.share(int(sys.argv[1]), int(sys.argv[2])))"
    own = [[sys.executable, "-c", code, str(i), str(n)] for i in range(n if n > 1 and in_use() and not _Process.shared else 0)]
    others = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for command in own]
    if others:
        _import()
    with _Process.bar(sum(kernel.types is not None for kernel in _kernels)) as reached:
        for done, line in enumerate(_lines(others), 1):
            _Process.compiled += tuple(line.split())
            reached(done)
    _Process.shared = True
    prepare(every=True)
    return _Process.compiled


def _lines(others: list[subprocess.Popen[str]]) -> Iterator[str]:
    """What processes print, line by line as it comes, until all have ended."""
    with selectors.DefaultSelector() as waited_for:
        for other in others:
            assert other.stdout is not None
            waited_for.register(other.stdout, selectors.EVENT_READ, other)
        while waited_for.get_map():
            for key, _ in waited_for.select():
                if line := key.fileobj.readline():  # type: ignore[union-attr]
                    yield line
                else:
                    waited_for.unregister(key.fileobj)
                    key.fileobj.close()  # type: ignore[union-attr]
                    key.data.wait()


@contextmanager
def _line_for_each(count: int) -> Iterator[Callable[[int], None]]:
    yield lambda done: print(flush=True)


def share(i: int, n: int) -> tuple[str, ...]:
    """Compile every n-th function that has a signature, from the i-th on, and what these call; the names.

    A line without a name is printed for each that is done.
    """
    _Process.told = True
    show_progress(_line_for_each)
    _import()
    _make([kernel for kernel in _kernels if kernel.types is not None][i::n])
    return _Process.compiled


def _make(kernels: Sequence[Kernel]) -> None:
    """Compile those that have types."""
    _listen()
    for name in _lessons:
        import_module(name)
    own = [kernel for kernel in kernels if kernel.types is not None]
    with _Process.bar(len(own)) as reached:
        for done, kernel in enumerate(own, 1):
            kernel.compile()
            if _Process.compiled:  # to load what is on disk takes a second, and is no compiling
                reached(done)


def _type(kind: Any) -> Any:
    """Numba's type."""
    import numba

    if isinstance(kind, _Array):
        return numba.types.Array(_type(kind.kind), kind.dim, kind.layout, readonly=kind.readonly)
    if isinstance(kind, _Record):
        return numba.types.NamedTuple(tuple(map(_type, kind.fields)), kind.kind)
    return numba.types.Tuple(tuple(map(_type, kind))) if isinstance(kind, tuple) else getattr(numba, kind or "void")


def _dispatcher(kernel: Kernel) -> Any:
    import numba

    # One without a signature is called by kernels alone, and need not be callable from Python.
    own = {} if kernel.types is not None else {"no_cpython_wrapper": True, "pipeline_class": _part_compiler()}
    made: Any = numba.njit(  # type: ignore[call-overload]
        kernel.function, error_model="numpy", no_cfunc_wrapper=True, **own, **kernel.options,
    )  # fmt: skip
    if kernel.types is None:  # it is kept within those that call it
        made._insert, made.get_call_template = _nothing, kernel.called_with
        return made
    try:
        made._cache = _store()(kernel)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        _Process.kept = False
    return made


def _nothing(*_: Any) -> None:
    """There is no machine code to be called from Python."""


@cache
def _part_compiler() -> Any:
    """Numba's compiler for functions that only compiled ones call: it ends with LLVM's code, optimised in those that call it.

    Optimising it, and compiling it to machine code that nothing runs, was half of the time.
    """
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import Compiler

    class Part(JITCodeLibrary):
        codegen = property(lambda self: self)
        set_env = _nothing

        def _optimize_final_module(self) -> None:
            pass

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            self._finalized = True

        def get_pointer_to_function(self, name: str) -> int:
            return 0

    class PartCompiler(Compiler):
        def define_pipelines(self) -> Any:
            self.state.library = Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
            return super().define_pipelines()

    return PartCompiler


@cache
def _store() -> Any:
    from numba.core.caching import FunctionCache, IndexDataCacheFile

    class Store(FunctionCache):
        """Of a kernel, as Numba's, but for two things.

        What is beside the package is read also where it cannot be written: who installed it may have compiled. And what is
        kept has a stamp of all that was compiled into it.
        """

        def __init__(self, kernel: Kernel) -> None:
            super().__init__(kernel.function)
            beside, stamp = _beside(kernel), (self._cache_file._source_stamp, _content(kernel))
            paths = [self.cache_path] if os.access(beside, os.W_OK) else list(dict.fromkeys((self.cache_path, beside)))
            self._files = [IndexDataCacheFile(path, self._impl.filename_base, stamp) for path in paths]
            for file in self._files[:]:
                try:
                    file._load_index()
                except (ImportError, AttributeError):  # it names a class that is gone, and Numba would end with an ImportError
                    self._files.remove(file) if file is not self._files[0] else file.flush()
            self._cache_file = self._files[0]

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            """A function that is kept, or None."""
            try:
                for file in self._files:
                    self._cache_file = file
                    if (found := super().load_overload(sig, target_context)) is not None:
                        return found
                return None
            finally:
                self._cache_file = self._files[0]

    return Store


def _beside(kernel: Kernel) -> str:
    return os.path.join(os.path.dirname(kernel.function.__code__.co_filename), "__pycache__")


@cache
def _content(kernel: Kernel) -> str:
    """A hash of what is compiled into a kernel: its source, the kernels it calls, and the numbers it names.

    Those may be of other modules. Numba looks at its source alone, and would go on with the others as they were.
    """
    reached, waiting, parts = {kernel}, [kernel], list[str]()
    while waiting:  # names may be those of attributes, so that one seems to call itself
        function = waiting.pop().function
        parts.append(_source(function.__code__.co_filename))
        named = [function.__globals__.get(name) for name in function.__code__.co_names]
        parts += [repr(each) for each in named if isinstance(each, int | float)]
        if taught := [each for each in named if isinstance(each, FunctionType)]:
            parts += [_source(file) for file in (taught[0].__code__.co_filename, *map(_file, _lessons))]
        for each in named:
            if isinstance(each, Kernel) and each not in reached:
                reached.add(each)
                waiting.append(each)
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _file(module: str) -> str:
    return str(sys.modules[module].__file__)


@cache
def _source(file: str) -> str:
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError:  # code without a file
        return file


@cache
def _listen() -> None:
    """Count compilations, and tell the first."""
    from numba.core import event

    class Compilations(event.Listener):
        def on_start(self, event: Any) -> None:
            function = event.data["dispatcher"].py_func
            if any(kernel.function is function for kernel in _kernels):
                if not _Process.told:
                    _tell()
                _Process.compiled += (f"{function.__module__}.{function.__name__}",)

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:compile", Compilations())


def _tell() -> None:
    _Process.told = True
    once = "once on this machine, up to a minute; `rbd warm-up` does it ahead"
    always = "up to a minute in every process, as no folder for it can be written; NUMBA_CACHE_DIR names another"
    if sys.stderr is not None:
        sys.stderr.write(f"rbd: compiling, {once if _Process.kept else always}.\n")
