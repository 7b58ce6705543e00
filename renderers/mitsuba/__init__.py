"""What all need of Mitsuba 3: bakery's plugins, the choice of a variant, and renders of Mitsuba's own XML scenes.

`import renderers.mitsuba` registers the plugins `bakedphase` and `bakedbsdf` in the variant that is set, and in every variant
that is set later.  It also points Dr.Jit to the LLVM library of the extra `llvm`, unless the user chose one.
"""

from bakery.errors import UsageError
from bakery.system import llvm as _llvm
from renderers.mitsuba import variants

_llvm.find()
variants.require_mitsuba()

import mitsuba as _mi  # noqa: E402  after find: Dr.Jit looks for LLVM once, when it is imported

from renderers.mitsuba import bakedbsdf as _bakedbsdf  # noqa: E402
from renderers.mitsuba import bakedphase as _bakedphase  # noqa: E402
from renderers.mitsuba.scene import describe, noted, render_scene  # noqa: E402

__all__ = ["describe", "register", "render_scene", "variants"]


def register() -> None:
    """Registers the plugins in the variant that is set now; no effect where none is set."""
    if _mi.variant() is None:
        return
    _mi.register_phase("bakedphase", noted(_bakedphase.define()))
    _mi.register_bsdf("bakedbsdf", noted(_bakedbsdf.define()))


def _refuse_old_llvm() -> None:
    """Mitsuba came first and took the system's LLVM: an old one would abort the process at the first kernel."""
    if (_mi.variant() or "").startswith("llvm"):
        import drjit

        if fault := _llvm.fault(tuple(drjit.detail.llvm_version())):
            raise UsageError(f"the variant {_mi.variant()} was set before `import renderers.mitsuba`, which finds LLVM for it: "
                             f"turn them round; {fault}")


_refuse_old_llvm()
# Base classes differ from variant to variant, so plugins are defined anew after each change.
_mi.detail.add_variant_callback(lambda old, new: register())
register()
