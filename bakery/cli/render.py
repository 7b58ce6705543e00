"""`bake render SCENE|ASSET`: a scene, or the standard preview of an asset."""

from __future__ import annotations

import click

from bakery.cli import offers
from bakery.cli.options import (
    at_option,
    file_of,
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


@click.command(name="render", short_help="render an asset's preview, or a scene")
@click.argument("source", type=click.Path(), metavar="SCENE|ASSET")
@click.option("-o", "--output", type=click.Path(), metavar="IMAGE",
              help="NAME.png or NAME.exr; both are written.  Default: beside the source.")
@click.option("--quality", metavar="|".join(QUALITIES), shell_complete=offers.qualities,
              help="Noise against time: 4, 2 or 1 times the noise that a scene asks for; a draft ends after 60 s at the latest.  "
                   "[default: final; preview of an asset]")
@click.option("--variant", metavar="NAME", help="Mitsuba variant (such as llvm_ad_mono); the best that runs by default.")
@click.option("--seed", type=click.IntRange(0), metavar="N", help="Seed of Mitsuba's pictures.  [default: 0]")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Override one value of a scene; repeatable.")
@click.option("--denoise/--no-denoise", default=None, help="Take the noise out of a scene's PNG, or not.  "
              "[default: as the scene says; else at draft and preview]")
@click.option("--resume", is_flag=True, help="Go on from the samples of the scene's EXR, where its renderer can.")
@click.option("--live", is_flag=True, help="Show a scene's picture on a page while it gets better; the page can stop it.")
@click.option("--live-port", "port", type=click.IntRange(0, 65535), metavar="N", help="Port of that page.  [default: a free one]")
@click.option("--frames", metavar="NUMBERS", help="Frames of a scene that has a section frames: 1-48, 1,5,9 or 1-48:2.")
@click.option("--cluster", metavar="ADDRESS", help="Render the frames on the workers of a Dask scheduler at this address.")
@at_option
@overwrite_option
@json_option
@quiet_option
def command(source, output, quality, variant, seed, settings, denoise, resume, live, port, frames, cluster, place, overwrite,
            as_json, quiet):
    """Render a SCENE (.yaml), a Mitsuba scene (.xml) in which bakery's plugins may be used, or the standard preview of an ASSET.

    A SCENE that names a recipe takes its asset where that is there and good enough; else it is baked first, into the cache.  No
    asset is replaced.  In a Mitsuba scene --set gives a parameter: `$NAME` in the file takes the value of --set NAME=VALUE.
    Prints the paths of both pictures; how they were made is said on standard error.  Exit status 3 where the noise or tolerance
    that a SCENE asks for was missed; a draft only tells.

    With --frames each frame is a picture of its own, NAME.0001.png and .exr; one that is there and made of the same is left as it
    is.  Of several there are a film (where ffmpeg is) and a contact sheet.
    """
    from contextlib import ExitStack
    from pathlib import Path

    from bakery.run import ahead, compiling
    from bakery.run.progress import choose
    from bakery.store import scratch

    path, folders = Path(source), ExitStack()
    suffix = path.suffix.lower()
    if not path.is_file() or suffix in (".png", ".exr"):
        kind = "a picture" if path.is_file() else "no file"
        raise UsageError(f'found "{source}", which is {kind}; a scene (.yaml or .xml) or an asset (.h5) would do')
    values = settings_of(None, None, None, settings)
    options = {"quality": quality, "variant": variant, "seed": seed, "overwrite": overwrite}
    prepared = None  # (path, progress) -> what is drawn
    if resume and suffix not in (".yaml", ".yml"):
        raise UsageError(f"--resume: {source} is no scene (.yaml); it is always rendered anew")
    if (live or port is not None) and suffix not in (".yaml", ".yml"):
        raise UsageError(f"--live: {source} is no scene (.yaml); nothing of it can be seen before its end, leave the option out")
    if place and suffix in (".yaml", ".yml", ".xml"):
        raise UsageError(f"--at: {source} is a scene, not a family; save the asset of a place and name that in the scene")
    if denoise is not None:
        if suffix not in (".yaml", ".yml"):
            raise UsageError(f"--{'' if denoise else 'no-'}denoise: {source} is no scene (.yaml); leave the option out")
        values["denoise"] = "yes" if denoise else "no"
    if frames is not None or cluster is not None:
        from bakery.cli.render_frames import rendered

        if live or port is not None:
            raise UsageError("--live: shows one picture, not the frames of a sequence; leave the option or --frames out")

        of_pictures = {name: options.pop(name) for name in ("quality", "variant", "seed")}
        options |= {"options": of_pictures, "overrides": values, "output": output, "resume": resume}
        return rendered(source, frames, cluster, options, as_json, quiet)
    if suffix in (".yaml", ".yml"):
        from importlib import import_module

        from renderers import scene
        from renderers.pictures import images, running
        from renderers.pictures.denoise import refuse_absent
        from renderers.scene import assets

        path = scene.load(path, values)
        renderer, target, name = import_module(path.renderer), output or path.picture, path.values.name
        if resume and not path.rules.RESUMES:
            raise UsageError(f"--resume: the renderer {path.section} cannot go on from an EXR; leave the option out")
        options |= {"resume": True} if resume else {}
        draw = renderer.render
        if live or port is not None:
            from bakery.cli.live import shown

            draw = folders.enter_context(shown(path, source, port or 0, browser=not as_json))
        if path.asset is None:
            images.output_pair(target, path.inputs, overwrite)  # before a bake, not after it
            running.refuse_too_large(path)
            refuse_absent(path)
            prepared = assets.baked
        ahead.expect(ahead.of_scene(path))
    elif suffix == ".xml":
        import renderers.materials.bodies.plugin
        import renderers.materials.grains.plugin  # noqa: F401
        import renderers.mitsuba as renderer

        options |= {"quality": quality or "final", "seed": seed or 0, "parameters": values}
        draw, target, name = renderer.render_scene, output or path.with_suffix(".png"), path.name
    else:
        import renderers.preview as renderer

        if values:
            raise UsageError(f"--set: {source} is an asset, whose preview has no values to set; a scene would do")
        options |= {"quality": quality or "preview", "seed": seed or 0}
        if place:
            between = one_asset(source, place)
            path = Path(file_of(between, folders.enter_context(scratch.folder("place"))))
            source = between.path
        draw, target, name = renderer.preview, output or Path(source).with_suffix(".png"), path.name
    progress = choose(quiet)
    try:
        if prepared:
            path = prepared(path, progress)
        progress.stage("render", f"picture of {name}", 0.0, 0.0)
        with compiling.watched(("renderers",), progress.compiling):
            report = draw(path, Path(target), **options, progress=progress.update)
    finally:
        progress.close()
        folders.close()
    if as_json:
        print_json(report)
    else:
        print_paths(report["files"])
        for line in renderer.describe(report):
            progress.say(line)
    return status_of_missed(target, report.get("missed", ()))  # only scenes ask for anything
