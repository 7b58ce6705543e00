"""Shortcuts through numba's compiler, taken while it compiles a kernel of ours: the same code in less time.

Most of what compiling takes is numba's own Python, and much of that finds out again what it has found before.  Inside of `taken`

- which signature a function of numba's has for arguments of some types is looked up where it was asked before: numba tries a
  dozen forms of `+` for each sum;
- what numba writes in Python itself (`np.empty`, `max`) is linked into its callers, as kernels that only kernels call are
  (`bakery/system/linked.py`), and has neither machine code nor functions for Python and C;
- which variables are alive is found out when it is asked for, and not again after every pass;
- functions that were declared since are looked for where numba keeps those that overloads declare, and in all other places once;
- variables of an instruction are listed by what kind of object each of its parts is, at once, and not by one test after another;
- where counts of references go up or down, those fields of a record are taken out of it that have counts, where numba takes out
  all of them: a fifth of the instructions that it writes, prints, and has LLVM read;
- fields of an array that is indexed are taken out of it, where numba lays it down in memory and reads them there: another tenth;
- how many bytes a type takes LLVM is asked once for each;
- whether a function of numba's that writes code takes `loc` is asked of its code, and not of a signature made for it;
- instructions that LLVM has read are taken apart: they refer to each other, and would stay until Python's collector finds them;
- nobody is told each time that LLVM is at work: that is for timers whose values nobody reads.

Outside of it numba is as it was: other people's kernels are compiled as ever.
"""

import sys
from contextlib import ExitStack, contextmanager
from functools import partial
from types import FunctionType

from llvmlite import binding as llvm
from numba.core import base, codegen, cpu, ir, postproc, targetconfig, transforms, types
from numba.core.registry import CPUDispatcher
from numba.core.runtime.context import NRTContext
from numba.core.typing import templates
from numba.np import arrayobj

from bakery.system import linked

_call_type = types.Function.get_call_type
_list_vars = ir.Inst._rec_list_vars
_jit_decorator = templates._OverloadFunctionTemplate._get_jit_decorator
_after_pass = postproc.PostProcessor.run
_refresh = cpu.CPUContext.refresh
_make_array = arrayobj.make_array
_ask_size = cpu.CPUContext.get_abi_sizeof
_ask_loc = base._has_loc
_add_module = codegen.CPUCodeLibrary.add_ir_module

# kinds of arguments whose types say all that a signature depends on
_PLAIN = (types.Number, types.Boolean, types.Array, types.BaseTuple, types.NumberClass, types.DType, types.SliceType,
          types.NoneType, types.StringLiteral)


@contextmanager
def taken(overload: type):
    """Takes them inside of the `with`, under numba's lock of compiling.

    overload : dispatcher of functions that numba writes in Python, in place of `CPUDispatcher`
    """
    lock = llvm.ffi.lib._lock
    others = [(types.Function, "get_call_type", _known_call_type), (cpu.CPUContext, "refresh", _refreshed_once()),
              (ir.Inst, "_rec_list_vars", _variables), (postproc.PostProcessor, "run", _after_pass_lazily),
              (codegen.CPUCodeLibrary, "add_ir_module", _added), (cpu.CPUContext, "get_abi_sizeof", _size_of),
              (base, "_has_loc", _has_loc), (NRTContext, "get_meminfos", _counted), (arrayobj, "make_array", _array_of),
              (templates._OverloadFunctionTemplate, "_get_jit_decorator", _linked_by(overload)), (lock, "_cblist", [])]
    with ExitStack() as stack:
        for owner, name, other in others:
            stack.enter_context(_instead(owner, name, other))
        yield


@contextmanager
def _instead(owner, name: str, other):
    is_inherited, before = name not in vars(owner), getattr(owner, name)
    setattr(owner, name, other)
    try:
        yield
    finally:
        if is_inherited:
            delattr(owner, name)
        else:
            setattr(owner, name, before)


def _linked_by(overload):
    def jit_decorator(template):
        jit = _jit_decorator(template)
        return lambda **options: lambda function: _as(overload, jit(**options)(function))

    return jit_decorator


def _as(overload, dispatcher):
    if type(dispatcher) is CPUDispatcher:
        dispatcher.__class__ = overload
        dispatcher._compiler.__class__ = linked.FunctionCompiler
    return dispatcher


_signatures: dict[tuple, tuple] = {}  # function, types and flags -> signature, and what numba finds the function's code by
_is_plain: dict[type, bool] = {}
_first_flags: dict = {}  # flags -> the first that were equal to them
_last_flags = None, None  # those asked for last, and the first that were equal


def _first_equal(flags):
    """The first flags that were equal to these.  Each kernel has flags of its own, and all flags the same hash: as part of a key
    they were compared six times a look-up."""
    global _last_flags
    if flags is not _last_flags[0]:
        _last_flags = flags, _first_flags.setdefault(flags, flags)
    return _last_flags[1]


def _known_call_type(function, context, args, kws):
    """As `BaseFunction.get_call_type`."""
    if kws or not all(map(_plain, args)):
        return _call_type(function, context, args, kws)
    # types of numba are the same where their numbers are
    flags = _first_equal(targetconfig.ConfigStack.top_or_none())
    key = function._code, tuple(kind._code for kind in args), id(flags), id(context)
    if key not in _signatures:
        signature = _call_type(function, context, args, kws)
        _signatures[key] = signature, function._impl_keys[signature.args]
    # the same function compiled with other flags may have been asked for since
    signature, function._impl_keys[signature.args] = _signatures[key]
    return signature


def _plain(kind) -> bool:
    exact = type(kind)
    if exact not in _is_plain:
        _is_plain[exact] = issubclass(exact, _PLAIN)
    return _is_plain[exact] and kind.is_precise()


_ATOMS = frozenset([str, int, float, complex, bool, type(None), ir.Loc])


def _variables(instruction, part):
    """As `Inst._rec_list_vars`."""
    kind = type(part)
    if kind in _ATOMS:
        return []
    if kind is ir.Var:
        return [part]
    if kind is dict:
        part = part.values()
    elif kind is not list and kind is not tuple:
        return _list_vars(instruction, part)
    return [variable for item in part for variable in _variables(instruction, item)]


def _after_pass_lazily(processor, emit_dels=False, extend_lifetimes=False):
    """As `PostProcessor.run`; without what objects and generators need, and numba asks for the rest where it wants it."""
    code = processor.func_ir
    if emit_dels or code.is_generator:
        return _after_pass(processor, emit_dels, extend_lifetimes)
    code.blocks = transforms.canonicalize_cfg(code.blocks)
    code.variable_lifetime, code.generator_info = postproc.VariableLifetime(code.blocks), None


_sizes: dict[str, int] = {}  # type in LLVM's form -> bytes


def _size_of(context, kind):
    """As `BaseContext.get_abi_sizeof`, which has LLVM read a module for each answer."""
    form = str(kind)
    if form not in _sizes:
        _sizes[form] = _ask_size(context, kind)
    return _sizes[form]


def _has_loc(function) -> bool:
    """As `base._has_loc`."""
    if type(function) is not FunctionType or not function.__dict__.keys().isdisjoint(("__wrapped__", "__signature__")):
        return _ask_loc(function)
    code = function.__code__
    return "loc" in code.co_varnames[:code.co_argcount + code.co_kwonlyargcount]


def _added(library, module):
    """As `CPUCodeLibrary.add_ir_module`, which is the last use of a module."""
    _add_module(library, module)
    for function in module.functions:
        for block in function.blocks:
            block.instructions.clear()
        function.blocks.clear()
        function.args = ()
    module.globals.clear()


def _refreshed_once():
    """As `BaseContext.refresh`, which imports what stands at the head of twenty modules again."""
    is_fresh = False

    def refresh(context):
        nonlocal is_fresh
        if is_fresh:
            # intrinsic functions of numba's declare themselves in the first of these when they are met
            for registry in context._registries:
                context.install_registry(registry)
            context.typing_context.install_registry(templates.builtin_registry)
        else:
            _refresh(context)
            is_fresh = True

    return refresh


_has_counts: dict[int, bool] = {}  # number of a type -> whether something in it has a count of references


def _counted(runtime, builder, kind, value):
    """As `NRTContext.get_meminfos`."""
    model = runtime._context.data_model_manager[kind]
    counted = [(kind, model.get_nrt_meminfo(builder, value))] if model.has_nrt_meminfo() else []
    for field, part in model.traverse(builder):
        if _may_count(runtime._context, field):
            counted += _counted(runtime, builder, field, part(value))
    return counted


def _may_count(context, kind) -> bool:
    if kind._code not in _has_counts:
        _has_counts[kind._code] = context.data_model_manager[kind].contains_nrt_meminfo()
    return _has_counts[kind._code]


# functions of numba's that read fields of the array that they make of a value, and do nothing else with it
_READERS = frozenset(function.__code__ for function in (arrayobj.getitem_arraynd_intp, arrayobj.getitem_array_tuple,
                                                        arrayobj.setitem_array, arrayobj.array_len))


def _array_of(kind):
    """As `arrayobj.make_array`."""
    reads = type(kind) is types.Array and sys._getframe(1).f_code in _READERS
    return partial(_Fields, kind) if reads else _make_array(kind)


class _Fields:
    """An array by the value that LLVM has for it."""

    def __init__(self, kind, context, builder, value):
        self._model, self._builder, self._value = context.data_model_manager[kind], builder, value

    def __getattr__(self, name):
        return self._builder.extract_value(self._value, self._model.get_field_position(name))
