"""`njit` of numba, whose kept kernels are those of all the sources that they were compiled from, and are compiled once.

numba keeps a kernel for as long as its own file stays as it is.  What the kernel calls, and constants that it uses, may stand in
other files; so the stamp of ours is a hash of the file and of every module of these packages that it imports, directly or not
(`bakery/system/sources.py`).

Compiling is most of what a first bake or render takes.  So a kernel is compiled for an integer whether or not a caller has a
constant there, without the function in C that only `cfunc` and functions kept as values need, without Python's collector of
garbage, which would go over all of numba's objects again and again, and by a single process: others wait for it and take what it
has kept.  What only kernels call has no machine code of its own (`bakery/system/linked.py`).
"""

import gc
from contextlib import contextmanager, nullcontext
from functools import cache
from pathlib import Path

import numba
from numba.core import caching, errors, event, targetconfig, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

from bakery.system import linked, shortcuts, sources, turns
from bakery.system.terminal import remark

__all__ = ["njit"]


class Kernel(CPUDispatcher):
    """A compiled function of these packages."""

    _called = False  # while a call from another kernel asks for a signature

    def get_call_template(self, args, kws):
        """As numba's, of a call from another kernel."""
        if self.targetoptions.get("fastmath"):
            # a constant, or another order of optimisations, may change which products and sums are made in a single step, and so
            # the last bit
            return super().get_call_template(args, kws)
        args, kws = [_number(kind) for kind in args], {name: _number(kind) for name, kind in kws.items()}
        self._called = _compiling > 0  # kernels of others do not give environments, see `linked`
        try:
            return super().get_call_template(args, kws)
        finally:
            self._called = False

    def compile(self, sig):
        """The entry point of a signature: there already, kept on disk, or compiled now."""
        # two threads may call it first: the second finds what the first has compiled.  What is added twice numba calls
        # ambiguous, and asks for it again by every call: 1 ms where a record of arrays is an argument
        with global_compiler_lock:
            arguments, called, self._called = tuple(getattr(sig, "args", sig)), self._called, False
            result = self.overloads.get(arguments)
            # of what is there numba's says so itself, and what is there for linking is what a call from another kernel takes
            if not self._can_compile or result is not None and (called or not linked.only(result)):
                return super().compile(sig)
            # a kernel that calls itself has its turn already
            turn = turns.of(self.turn, _waiting(self)) if self._cache.cache_path is not None else nullcontext()
            with turn, _no_collector(), _depth():
                entry = self._link(arguments) if called else None
                if entry is None:
                    self.overloads.pop(arguments, None)
                    entry = super().compile(sig)
                    linked.give_environments(self.overloads[arguments])
                return entry

    def _link(self, arguments):
        """What other kernels call this one by for arguments of these types; None where it has to have machine code."""
        cache = linked.Cache(self) if self._cache.cache_path is not None else None
        result = cache and (self._cache.load_overload(arguments, self.targetctx) or cache.load(arguments))
        if result is None:
            details = {"dispatcher": self, "args": arguments, "return_type": None, "linking": True}
            try:
                with event.trigger_event("numba:compile", data=details), self._compiling_counter:
                    result = self._compiler.for_linking(arguments)
            except errors.NumbaError:
                return None  # numba's own way says it as numba does
            if result is not None and cache:
                cache.save(arguments, result)
        if result is not None:
            self.targetctx.insert_user_function(result.entry_point, result.fndesc, [result.library])
            if linked.only(result):
                self.overloads[arguments] = result
            else:
                self.add_overload(result)
        return result and result.entry_point

    @property
    def turn(self) -> str:
        """What a process has while it compiles this kernel, see `bakery.system.turns`."""
        return f"{self._cache.cache_path}/{self.py_func.__module__}.{self.py_func.__qualname__}"

    def is_kept(self, arguments) -> bool:
        """Whether a signature is there, in this process or on disk."""
        if arguments in self.overloads or self._cache.cache_path is None:
            return arguments in self.overloads
        return self._cache._index_key(arguments, self.targetctx.codegen()) in self._cache._cache_file._load_index()


class Overload(Kernel):
    """A function that numba has in Python, as a kernel of ours calls it."""

    def get_call_template(self, args, kws):
        """As numba's, of a call from another kernel."""
        flags = targetconfig.ConfigStack.top_or_none()
        self._called = _compiling > 0 and not (flags and flags.fastmath)
        try:
            return super(Kernel, self).get_call_template(args, kws)
        finally:
            self._called = False


_compiling = 0  # how many kernels are being compiled, each because the one before calls it; under numba's lock


@contextmanager
def _depth():
    global _compiling
    _compiling += 1
    try:
        with shortcuts.taken(Overload) if _compiling == 1 else nullcontext():
            yield
    finally:
        _compiling -= 1


def njit(*function, **options):
    """As `numba.njit`, with what the head of this module says."""
    if function:
        return _kernel(numba.njit(no_cfunc_wrapper=True)(*function))
    return lambda py_func: _kernel(_dispatcher(py_func, {"no_cfunc_wrapper": True} | options))


def _dispatcher(py_func, options):
    """numba's; its kernels are not kept where there is no folder for them, as in a container whose user has no home."""
    try:
        return numba.njit(**options)(py_func)
    except RuntimeError as fault:
        if not options.get("cache") or "no locator available" not in str(fault):
            raise
        _say_that_none_is_kept()
        return numba.njit(**options | {"cache": False})(py_func)


@cache
def _say_that_none_is_kept():
    remark("compiled kernels are not kept, and compiled again by each command: neither the package's folder nor the user's cache "
           "can be written; NUMBA_CACHE_DIR names another folder")


def _kernel(dispatcher):
    # numba asks for the class by the target and not by an option; ours adds no fields.  Without a compiler it is the function
    if type(dispatcher) is CPUDispatcher:
        dispatcher.__class__ = Kernel
        dispatcher._compiler.__class__ = linked.FunctionCompiler
        if hasattr(dispatcher._cache, "_cache_file"):
            dispatcher._cache._cache_file.__class__ = _Index
    return dispatcher


def _number(kind):
    """The type of an argument, of an integer that the caller knows just that: numba would compile a kernel for each of them."""
    return types.unliteral(kind) if isinstance(kind, (types.IntegerLiteral, types.BooleanLiteral)) else kind


@contextmanager
def _no_collector():
    """No collection of garbage inside of the `with`, a sixth of the time that compiling takes, nor right after it, 5 % more."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        # makes all objects old ones, which are looked at rarely
        if not gc.get_freeze_count():
            gc.freeze()
            gc.unfreeze()
        gc.enable()


@contextmanager
def _waiting(dispatcher):
    """While another process compiles: who counts the time of compiling counts this as well."""
    with event.trigger_event("numba:compile", data={"dispatcher": dispatcher, "args": (), "return_type": None, "waiting": True}):
        yield


class _Index(caching.IndexDataCacheFile):
    """Which kernels numba keeps of a function."""

    def _load_index(self):
        try:
            return super()._load_index()
        except (AttributeError, ImportError):
            return {}  # kept by other sources: a record that it names has moved since, or is gone


class _BySources:
    """Of a numba locator, which says where a kernel is kept and by which stamp: that of all its sources."""

    @classmethod
    def from_function(cls, py_func, py_file):
        return super().from_function(py_func, py_file) if sources.package(Path(py_file)) in sources.PACKAGES else None

    def get_source_stamp(self):
        return sources.stamp(Path(self._py_file))


# before numba's own, of which each tries another folder: the user's, the source's, one in the home folder
caching.CacheImpl._locator_classes[:0] = [type(f"BySources{theirs.__name__}", (_BySources, theirs), {})
                                          for theirs in caching.CacheImpl._locator_classes[:3]]
