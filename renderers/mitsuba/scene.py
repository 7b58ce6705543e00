"""Renders a Mitsuba scene file with bakery's plugins (the `mitsuba` command of 3.9 cannot load Python plugins)."""

import time
from functools import wraps
from pathlib import Path

from bakery.errors import AssetError, BakeryError, UsageError
from renderers.mitsuba import bitmaps, lights, messages, normals, passes, variants
from renderers.pictures import images, reached
from renderers.scene import inputs

STOPPED = {"noise": "the noise wanted was reached", "samples": "all samples were taken",
           "time": "the time limit was reached, so the picture depends on the machine"}
# What plugins could not do while a scene was loaded or rendered, newest last.
faults: list[BakeryError] = []


def noted(function):
    """A plugin's constructor or method, whose errors are kept: Mitsuba keeps the text of an exception only."""

    @wraps(function)
    def wrapped(*args, **options):
        try:
            return function(*args, **options)
        except BakeryError as error:
            faults.append(error)
            raise

    return wrapped


def load(path, *, colour="rgb", variant=None, parameters=None, sensor=True, integrator=False):
    """A scene of Mitsuba from XML, with bakery's plugins; the variant that runs, and why.

    path, colour, variant, parameters : as in `render_scene`, and what it raises
    sensor, integrator : whether the scene has to have one
    """
    if fault := inputs.unbounded(path, parameters):
        raise UsageError(f"{path}: names {fault}")
    chosen, reason = variants.activate(colour, variant)
    mi = bitmaps.library()  # scenes may read pictures, such as an environment
    faults.clear()
    try:
        # optimised, shapes with equal BSDFs become one without an id, in an order that changes from run to run; read by several
        # threads, so do the numbers of objects, which Dr.Jit's kernels hold (four meshes of 500,000 triangles: 1.2 s either way)
        with normals.one_kernel(), messages.on_standard_error():
            scene = mi.load_file(str(path), optimize=False, parallel=False,
                                 **{key: str(value) for key, value in (parameters or {}).items()})
    except (RuntimeError, ValueError, TypeError, BakeryError) as error:
        if faults:
            raise _of_plugin(path) from None
        raise UsageError(f"{path}: Mitsuba cannot load this scene: {error}") from None
    if sensor and not scene.sensors():
        raise UsageError(f"{path}: the scene has no sensor, so there is no view to render")
    if integrator and scene.integrator() is None:
        raise UsageError(f'{path}: the scene has no integrator; expected <integrator type="path"/> or another one')
    lights.refuse(path, scene)
    if not variants.on_gpu(chosen):
        normals.settle(scene)
    return scene, chosen, reason


def _of_plugin(path):
    """The error to raise for what a plugin could not do."""
    kind = AssetError if isinstance(faults[-1], AssetError) else UsageError
    return kind(f"{path}: {faults[-1]}")


def render_scene(scene_path, output, *, quality="final", colour="rgb", variant=None, seed=0, parameters=None,
                 progress=None, overwrite=False) -> dict:
    """Renders an XML scene to a PNG and an EXR file beside each other.

    Parameters
    ----------
    scene_path : Mitsuba XML; names of assets in it are relative to the scene
    output : `X.png` or `X.exr`; both are written
    colour : `rgb`, `mono`, `spectral` or `spectral_polarized`; the machine's best variant of that kind is used
    variant : a variant by name, instead
    quality : `final` takes the samples that the scene asks for, `preview` a quarter, `draft` a sixteenth
    seed, progress : as in `passes.render`
    parameters : dict, `$name` in the scene -> value
    overwrite : replace also files that are no such pictures; never one that the scene reads

    Returns
    -------
    report : dict with `files`, `variant`, `reason`, `seconds`, `samples`, `noise`, `stopped_by`, `tone_curve`, `reasons` (what
        else is to be said of the picture)

    Raises
    ------
    UsageError : no such scene, a faulty scene or light, or a place that cannot be written
    AssetError : an asset that the scene names is damaged or lacks a stage
    """
    begin = time.monotonic()
    scene_path = Path(scene_path)
    coarser = reached.coarser(quality)
    if not scene_path.is_file():
        raise UsageError(f"{scene_path}: there is no such scene; give the path of a Mitsuba scene (.xml)")
    pair = images.output_pair(output, inputs.files_of(scene_path, parameters), overwrite)
    scene, chosen, reason = load(scene_path, colour=colour, variant=variant, parameters=parameters, integrator=True)
    images.refuse_too_large(scene_path, *reversed([int(side) for side in scene.sensors()[0].film().crop_size()]))
    samples = max(1, round(scene.sensors()[0].sampler().sample_count() / coarser**2))
    try:
        picture = passes.render([scene], None, samples=samples, per_pass=max(1, -(-samples // 8)), seed=seed,
                                progress=progress)
    except (RuntimeError, UsageError):
        if faults:
            raise _of_plugin(scene_path) from None
        raise
    bitmaps.write(pair, images.tone_map(picture.rgb), picture.rgb)
    return {"files": [str(path) for path in pair], "variant": chosen, "reason": reason, "seconds": time.monotonic() - begin,
            "samples": picture.samples, "noise": picture.noise, "stopped_by": picture.stopped_by, "tone_curve": images.TONE_CURVE,
            "reasons": [lights.DARK] * lights.dark(scene)}


def describe(report) -> list[str]:
    """Lines for a report with `files`, `variant`, `reason`, `samples`, `seconds`, `noise` and `stopped_by`, such as that of
    `render_scene`; `noise_shown`, if it is there, is that of the filtered PNG, and `noise_of` the file whose noise stops the
    passes."""
    noise = f"noise {100 * report['noise']:.2g} %"
    if "noise_shown" in report:
        noise += f", {100 * report['noise_shown']:.2g} % in the filtered PNG"
    of = f" in the {report['noise_of']}" if report["stopped_by"] == "noise" and "noise_of" in report else ""
    return [f"pictures: {', '.join(report['files'])}",
            f"variant: {report['variant']} ({report['reason']})",
            f"samples: {report['samples']} a pixel and wavelength in {report['seconds']:.1f} s; {noise}; "
            f"{STOPPED[report['stopped_by']]}{of}", *report.get("reasons", [])]
