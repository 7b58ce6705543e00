"""`bake render SCENE|ASSET`: a scene, or the standard preview of an asset."""

from collections.abc import Callable
from typing import NamedTuple

import click

from bakery.cli import offers
from bakery.cli.options import (
    SEED,
    at_option,
    file_of,
    gathered,
    json_option,
    one_asset,
    overwrite_option,
    print_json,
    print_paths,
    quiet_option,
    settings_of,
    status_of_missed,
)
from bakery.errors import UsageError
from bakery.grammar.qualities import QUALITIES

SCENES = (".yaml", ".yml")


class _Picture(NamedTuple):
    """What is asked of a picture."""

    quality: str | None
    variant: str | None
    seed: int | None
    settings: tuple[str, ...]
    denoise: bool | None
    resume: bool
    live: bool
    port: int | None
    frames: str | None
    cluster: str | None


@click.command(name="render", short_help="render an asset's preview, or a scene")
@click.argument("source", type=click.Path(), metavar="SCENE|ASSET")
@click.option("-o", "--output", type=click.Path(), metavar="IMAGE or DIR/",
              help="NAME.png or NAME.exr, of which both are written, or the folder for them.  Default: beside the source.")
@gathered(
    "asked", _Picture,
    click.option("--quality", metavar="|".join(QUALITIES), shell_complete=offers.qualities,
                 help="draft: 4 times the noise that a scene asks for, within 60 s; preview: twice.  [default: final, as the "
                      "scene asks; preview for an asset]"),
    click.option("--variant", metavar="NAME", help="Mitsuba variant, such as llvm_ad_rgb.  [default: the best that runs here]"),
    click.option("--seed", type=SEED, metavar="N", help="Seed of the picture's random numbers.  [default: 0]"),
    click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Override one value of a scene; repeatable."),
    click.option("--denoise/--no-denoise", default=None, help="Remove the noise from a scene's PNG, or keep it.  [default: the "
                                                              "scene's setting; else at draft and preview]"),
    click.option("--resume", is_flag=True, help="Add samples to the picture in the scene's EXR, if its renderer can."),
    click.option("--live", is_flag=True, help="Show a scene's picture on a web page while it renders; the page can stop it."),
    click.option("--live-port", "port", type=click.IntRange(0, 65535), metavar="N",
                 help="Port of that page.  [default: a free one]"),
    click.option("--frames", metavar="NUMBERS",
                 help="Frames to render (1-48, 1,5,9 or 1-48:2) of a scene with a section `frames`."),
    click.option("--cluster", metavar="ADDRESS",
                 help="Share frames or passes of a scene among the workers of a Dask scheduler at this address."))
@at_option
@overwrite_option
@json_option
@quiet_option
def command(source, output, asked, coordinates, overwrite, as_json, quiet):
    """Render a SCENE (.yaml), a Mitsuba scene (.xml), which may use Bakery's plugins, or the standard preview of an ASSET.

    If a SCENE names a recipe, its asset is used if it exists and is good enough; otherwise it is baked first, into the cache.  No
    asset is replaced.  For a Mitsuba scene --set NAME=VALUE sets the parameter `$NAME` of the file.  Standard output gets the
    paths of both pictures, standard error how they were made.  Exit status 3 if the noise or tolerance that a SCENE asks for
    was missed; a draft only reports it.

    With --frames each frame is a picture NAME.0001.png and .exr; an existing frame with the same inputs is kept.  Several frames
    also give a film (if ffmpeg is installed) and a contact sheet.  With --cluster workers render whole frames, or the passes of
    one picture; the bytes are those of one machine.
    """
    from contextlib import ExitStack
    from pathlib import Path

    from bakery.run import compiling, dask
    from bakery.run.progress import choose
    from bakery.system.terminal import warned

    suffix, live, denoise = Path(source).suffix.lower(), asked.live or asked.port is not None, asked.denoise
    _check(source, suffix, {"--resume": asked.resume, "--live": live, "--cluster": asked.cluster is not None,
                            f"--{'' if denoise else 'no-'}denoise": denoise is not None}, coordinates)
    values = settings_of(None, None, None, asked.settings) | ({} if denoise is None else {"denoise": "yes" if denoise else "no"})
    options = {"quality": asked.quality, "variant": asked.variant, "seed": asked.seed, "overwrite": overwrite}
    if asked.cluster is not None:
        dask.check_address(asked.cluster)
    if live and asked.cluster is not None:
        raise UsageError("--live: shows passes of this process; leave the option or --cluster out")
    if asked.frames is not None:
        from bakery.cli.render_frames import rendered

        if live:
            raise UsageError("--live: shows one picture, not the frames of a sequence; leave the option or --frames out")
        of_pictures = {name: options.pop(name) for name in ("quality", "variant", "seed")}
        options |= {"options": of_pictures, "overrides": values, "output": output, "resume": asked.resume}
        return rendered(source, asked.frames, asked.cluster, options, as_json, quiet)
    folders, progress = ExitStack(), choose(quiet)
    try:
        folders.enter_context(warned(progress.say))
        if suffix in SCENES:
            options |= ({"resume": True} if asked.resume else {}) | ({} if asked.cluster is None else {"elsewhere": None})
            job = _of_scene(source, output, values, options, progress, live)
            job = _elsewhere(job, source, asked, folders, progress, browser=not as_json)
        elif suffix == ".xml":
            job = _of_mitsuba(source, output, values, options)
        else:
            job = _of_asset(source, output, values, options, coordinates, folders)
        progress.stage("render", f"picture of {job.name}", 0.0, 0.0)
        with compiling.watched(("renderers",), progress.compiling):
            report = job.draw(job.path, job.target, **job.options, progress=progress.update)
    finally:
        progress.close()
        folders.close()
    if as_json:
        print_json(report)
    else:
        print_paths(report["files"])
        for line in job.renderer.describe(report):
            progress.say(line)
    return status_of_missed(job.target, report.get("missed", ()))  # only scenes ask for anything


class _Job(NamedTuple):
    """What is drawn: the module that renders it, its function, source and target, name for people, options."""

    renderer: object
    draw: Callable
    path: object
    target: object
    name: str
    options: dict


_ANEW = {"--resume": "it is always rendered from the start", "--cluster": "it has no frames or passes to share",
         "--live": "it has no passes to show, leave the option out"}


def _check(source, suffix, of_scenes, coordinates) -> None:
    """UsageError where there is no such file, or options are not for files of its kind.

    of_scenes : options that only scenes have, and whether each was given
    """
    from pathlib import Path

    is_file = Path(source).is_file()
    if not is_file or suffix in (".png", ".exr"):
        kind = "a picture" if is_file else "no file"
        raise UsageError(f'found "{source}", which is {kind}; expected a scene (.yaml or .xml) or an asset (.h5)')
    if coordinates and suffix in (*SCENES, ".xml"):
        raise UsageError(f"--at: {source} is a scene, not a family; save the asset of a place and name that in the scene")
    for option, given in of_scenes.items():
        if given and suffix not in SCENES:
            raise UsageError(f"{option}: {source} is no scene (.yaml); {_ANEW.get(option, 'leave the option out')}")


def _of_scene(source, output, values, options, progress, live) -> _Job:
    """A scene, its asset baked where that is due; live : it is looked at while it is rendered."""
    from pathlib import Path

    from bakery.run import ahead
    from bakery.store.outputs import named
    from renderers import scene

    path = scene.load(Path(source), values)
    ahead.expect(ahead.of_scene(path))  # before Mitsuba is loaded

    from renderers.pictures import images, running
    from renderers.pictures.denoise import refuse_absent
    from renderers.scene import assets

    renderer, target, name = path.drawn_by, named(output, path.picture), path.values.name
    if "resume" in options and not path.rules.RESUMES:
        raise UsageError(f"--resume: the renderer {path.section} cannot go on from an EXR; leave the option out")
    if "elsewhere" in options and not path.rules.RESUMES:
        raise UsageError(f"--cluster: the renderer {path.section} has no passes that workers could share; leave the option out")
    if live:
        from renderers.pictures.live import refuse_other

        refuse_other(path)
    if path.asset is None:
        images.output_pair(target, path.inputs, options["overwrite"])  # before a bake, not after it
        running.refuse_too_large(path)
        refuse_absent(path)
        path = assets.baked(path, progress)
    return _Job(renderer, renderer.render, path, target, name, options)


def _elsewhere(job, source, asked, folders, progress, browser) -> _Job:
    """The job of a scene, with its passes on a cluster or shown on a page, where that is asked for; folders : keeps both open."""
    if asked.cluster is not None:
        from bakery.run import dask
        from renderers.cluster.passes import workers

        cluster = folders.enter_context(dask.cluster(asked.cluster, progress.say))
        return job._replace(options=job.options | {"elsewhere": workers(cluster)})
    if asked.live or asked.port is not None:
        from bakery.cli.live import shown

        return job._replace(draw=folders.enter_context(shown(job.path, source, asked.port or 0, browser=browser)))
    return job


def _of_mitsuba(source, output, values, options) -> _Job:
    """A Mitsuba scene; `values` are its parameters."""
    from pathlib import Path

    import renderers.materials.bodies.plugin
    import renderers.materials.grains.plugin  # noqa: F401
    import renderers.mitsuba as renderer
    from bakery.store.outputs import named

    path = Path(source)
    options = options | {"quality": options["quality"] or "final", "seed": options["seed"] or 0, "parameters": values}
    return _Job(renderer, renderer.render_scene, path, named(output, path.with_suffix(".png")), path.name, options)


def _of_asset(source, output, values, options, coordinates, folders) -> _Job:
    """The preview of an asset, or of a place of a family: `folders` holds the asset that is made of that."""
    from pathlib import Path

    import renderers.preview as renderer
    from bakery.store import scratch
    from bakery.store.outputs import named

    if values:
        raise UsageError(f"--set: {source} is an asset, whose preview has no values to set; expected a scene")
    path = Path(source)
    if coordinates:
        between = one_asset(source, coordinates)
        path, source = Path(file_of(between, folders.enter_context(scratch.folder("place")))), between.path
    options = options | {"quality": options["quality"] or "preview", "seed": options["seed"] or 0}
    return _Job(renderer, renderer.preview, path, named(output, Path(source).with_suffix(".png")), path.name, options)
