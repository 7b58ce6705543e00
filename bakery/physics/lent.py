"""Arrays that a loop takes from its caller, without counting them.

Where a compiled function takes arrays, they are counted when it is called and when it returns, by atomic instructions: among the
dozen arrays of an aggregate that is most of the time of finding a sphere (1.0 us against 0.6).
"""

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def lent(typingctx, value):
    """A tuple of arrays, numbers and such tuples, in which nobody counts how often the arrays are held.

    For arguments of a compiled function that Python calls: Python holds them until it returns.  What the function makes itself
    would be gone after its last mention.
    """

    def codegen(context, builder, signature, args):
        return _uncounted(context, builder, signature.args[0], args[0])

    return value(value), codegen


def _uncounted(context, builder, kind, value):
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo, array.parent = (cgutils.get_null_value(field.type) for field in (array.meminfo, array.parent))
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        for i, field in enumerate(kind.types):
            value = builder.insert_value(value, _uncounted(context, builder, field, builder.extract_value(value, i)), i)
    return value
