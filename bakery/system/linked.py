"""Code of kernels that only other kernels call: linked into these, and not compiled by itself.

numba gives every kernel machine code and a function for Python to call, that of a kernel which a thousand lines of others call
as well.  Whoever calls it takes its code in LLVM's form and makes machine code of it anew.  So of a kernel that is met in a call
from another one, that form is all that is made and kept.
"""

from __future__ import annotations

import copy
from pathlib import Path

import llvmlite.binding as llvm
from numba.core import codegen, compiler, dispatcher, environment

_UNRESOLVED = codegen.RuntimeLinker.PREFIX  # of a function that calls itself: an address, known when it has machine code
_ENVIRONMENT = "_ZN08NumbaEnv"  # of a function's constants: an address as well


class Library(codegen.JITCodeLibrary):
    """A library of numba's that is linked into others, and for which no machine code is made."""

    def _optimize_final_module(self):
        # the kernels that it is linked into are optimised with it, once more and in full; without this one, which drops counts
        # of references and dead branches, compiling takes as long, and with all of numba's a sixth longer
        passes, builder = self._codegen._module_pass_manager(loop_vectorize=False, slp_vectorize=False,
                                                             opt=self._codegen._opt_level, cost="cheap")
        passes.run(self._final_module, builder)

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    @classmethod
    def read(cls, target, name: str, bitcode: bytes) -> Library:
        library = cls(target, name)
        library._final_module = library._shared_module = llvm.parse_bitcode(bitcode)
        library._finalize_final_module()
        return library

    def needs_address(self) -> bool:
        """Whether some function has to have machine code of its own before another can call it."""
        return any(variable.name.startswith(_UNRESOLVED) for variable in self._final_module.global_variables)


class _Flags(compiler.Flags):
    """numba's, which it compares thousands of times a kernel, all forty of them: here those that are set."""

    __slots__ = ()
    _HASH = hash(compiler.Flags())  # of their names, so that of all flags

    def __hash__(self):
        return self._HASH

    def __eq__(self, other):
        if not isinstance(other, compiler.Flags):
            return NotImplemented
        return self._values == other._values or all(getattr(self, name) == getattr(other, name)
                                                    for name in self._values.keys() | other._values.keys())


class _ForLinking(compiler.Compiler):
    """numba's passes, for a library that is linked into others."""

    def define_pipelines(self):
        # here and not where flags are made: functions of numba's that a kernel calls are compiled for each set of those
        flags = self.state.flags
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = flags.no_compile = True
        return super().define_pipelines()


class FunctionCompiler(dispatcher._FunctionCompiler):
    """numba's, of a kernel."""

    def _compile_core(self, args, return_type):
        return self._compiled(args, return_type, self.pipeline_class)

    def for_linking(self, args):
        """What numba compiles for arguments of these types, for linking alone; None where that cannot be.

        Raises numba.core.errors.NumbaError : as where numba compiles it
        """
        library = Library(self.targetdescr.target_context.codegen(), self.py_func.__qualname__)
        result = self._compiled(args, None, _ForLinking, library)
        library.finalize()
        return None if library.needs_address() else result._replace(entry_point=_Name(self.py_func))

    def _compiled(self, args, return_type, pipeline, library=None):
        flags = _Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        result = compiler.compile_extra(self.targetdescr.typing_context, self.targetdescr.target_context, self.py_func, args,
                                        return_type, flags, self.locals, library, pipeline)
        # instructions of numba's and their types, for people to read, and times of its passes: ten thousand objects a kernel, at
        # which each collection of garbage would look, one a picture.  Of kernels that were kept numba has none either
        result.fndesc.typemap = result.fndesc.calltypes = None
        return result._replace(type_annotation="", metadata=None)


class _Name:
    """What a kernel is known by to those that call it, in place of a function for Python to call."""

    def __init__(self, function):
        self._kernel = function.__qualname__

    def __repr__(self):
        return f"<linked {self._kernel}>"


def only(result) -> bool:
    """Whether a result of compiling is for linking alone."""
    return isinstance(result.entry_point, _Name)


def give_environments(result) -> None:
    """Tells machine code where the constants of the functions are that were linked into it: nobody else does."""
    for variable in result.library._final_module.global_variables:
        constants = environment.lookup_environment(variable.name) if variable.name.startswith(_ENVIRONMENT) else None
        if constants is not None:
            result.library.codegen.set_env(variable.name, constants)


class Cache:
    """Results for linking alone, beside what numba keeps of a kernel: `module.linked-kernel-12.py311.nbi`."""

    def __init__(self, kernel):
        self._kernel, kept = kernel, kernel._cache
        self._file = copy.copy(kept._cache_file)
        module, name = kept._impl.filename_base.split(".", 1)
        self._file.__init__(cache_path=kept.cache_path, filename_base=f"{module}.linked-{name}",
                            source_stamp=kept._impl.locator.get_source_stamp())

    def load(self, arguments: tuple):
        """What is kept for arguments of these types, or None."""
        kernel = self._kernel
        with kernel._cache._guard_against_spurious_io_errors():
            kept = self._file.load(self._key(arguments))
            return None if kept is None else _read(kernel, *kept)

    def save(self, arguments: tuple, result) -> None:
        kernel = self._kernel
        with kernel._cache._guard_against_spurious_io_errors():
            if kernel._cache._impl.check_cachable(result):
                Path(kernel._cache.cache_path).mkdir(parents=True, exist_ok=True)
                self._file.save(self._key(arguments), _written(result))

    def _key(self, arguments):
        return self._kernel._cache._index_key(arguments, self._kernel.targetctx.codegen())


def _written(result) -> tuple:
    """As numba's `CompileResult._reduce`."""
    return (result.library.name, result.library._get_module_for_linking().as_bitcode(), result.fndesc, result.environment,
            result.signature, result.reload_init, tuple(result._find_referenced_environments()))


def _read(kernel, name, bitcode, fndesc, constants, signature, reload_init, all_constants):
    for function in reload_init:
        function()
    context = kernel.targetctx
    return compiler.compile_result(
        target_context=context, typing_context=context.typing_context, entry_point=_Name(kernel.py_func), fndesc=fndesc,
        environment=constants, library=Library.read(context.codegen(), name, bitcode), signature=signature, objectmode=False,
        lifted=(), type_annotation="", typing_error=None, call_helper=None, metadata=None, reload_init=reload_init,
        referenced_envs=all_constants)
