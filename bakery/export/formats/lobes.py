"""What formats share whose media have the same lobes at all wavelengths, and say what those lose."""

import math

from bakery.export.declaration import Job, Option, Written, delta_taken_out

PEAK = math.radians(2)  # --unscattered-within is tried with it, and
WORTH = 0.05  # of the light: what it must save to be named


def angle(text: str) -> float:
    """`1deg` in rad."""
    from bakery.export.mixture import WIDEST
    from bakery.grammar.units import ANGLE, asked

    return asked("--unscattered-within", text, ANGLE, (0, WIDEST), f"angles above 0 to {math.degrees(WIDEST):g}deg")


WITHIN = Option("--unscattered-within", "count the forward peak within this angle, such as 1deg, as unscattered light.", "ANGLE",
                angle)
IN_COLOUR = "Coefficients are means over a red, a green and a blue band of the asset's."


def written(job: Job, fitted, end: str, text, spectra: bool = False) -> Written:
    """One file.

    fitted : function of (tree, name, angle within which light counts as unscattered) -> medium with lobes
    end : of the file's name;  text : function of the medium -> content
    spectra : the file has the coefficients at all wavelengths of the asset
    """
    asset, within = job.asset, job.settings.get(WITHIN.name, 0.0)
    medium = fitted(asset.tree, asset.name, within)
    lines = _lines(medium, None if within or medium.misdirected < WORTH else fitted(asset.tree, asset.name, PEAK))
    if not spectra and asset.wavelength.size > 1 and job.colour.rgb_order(asset.wavelength) is None:
        lines.append(IN_COLOUR)
    file = f"{job.stem}.{end}"
    warnings = [f"{file}: {line}" for line in medium.useless()] + job.unreached_bands(file)
    return Written({file: text(medium)}, medium.as_dicts(), lines, warnings)


def _lines(medium, folded) -> list[str]:
    """What lobes lose, as a table and in words; `folded` is the medium without its forward peak, if that was tried."""
    from bakery.export.one_lobe import OneLobe
    from bakery.system.terminal import table

    head = ("  lost against the asset", "misdirected", "error of g", "reduced scattering", "in the peak")
    rows = [(f"  at {um:g} um", f"{100 * loss.misdirected:.2g} %", f"{round(loss.misfit.g, 4) + 0.0:+.4f}",
             f"{100 * loss.reduced:+.2g} %", f"{100 * loss.misfit.peak:.3g} % instead of {100 * loss.misfit.peak_table:.3g} % "
             f"in {math.degrees(loss.misfit.peak_angle):.3g} deg")
            for um, loss in zip(medium.um.tolist(), medium.losses, strict=True)]
    lobes = " + ".join(f"{weight:.3f} of {'Draine' if alpha else 'Henyey-Greenstein'} with g {g:.4f}"
                       + (f" and alpha {alpha:.3g}" if alpha else "")
                       for weight, g, alpha in zip(medium.lobes.weight, medium.lobes.g, medium.lobes.alpha, strict=True))
    uniform = len(medium.lobes.g) == 1 and not any(medium.lobes.alpha)
    lines = [f"phase function: one Henyey-Greenstein lobe for all wavelengths, g {medium.lobes.g[0]:.4f}" if uniform else
            f"phase function for all wavelengths: {lobes}", *table([head, *rows])]
    if isinstance(medium, OneLobe):
        least = max(loss.misdirected for loss in medium.best_losses)
        if least < medium.misdirected - 0.005:
            off = max((1 + loss.reduced for loss in medium.best_losses), key=lambda ratio: abs(math.log(ratio)))
            lines.append(f"g {medium.best:.4f} would misdirect {100 * least:.2g} %, but multiply the reduced scattering by "
                        f"{off:.2g}: only for media that scatter once.")
    lines += delta_taken_out(medium.delta, "sigma_s")
    if medium.within:
        lines.append(f"forward peak: up to {100 * medium.unscattered:.2g} % of the scattered light is deflected by less than "
                    f"{math.degrees(medium.within):.3g} deg and counts as unscattered: sigma_s and sigma_t are smaller by it, "
                    "and what is seen through the medium is brighter and sharper.")
    if folded and folded.misdirected < medium.misdirected - WORTH:
        lines.append(f"--unscattered-within {math.degrees(PEAK):g}deg would misdirect {100 * folded.misdirected:.2g} %: up to "
                    f"{100 * folded.unscattered:.2g} % of the scattered light, deflected by less, would count as unscattered "
                    "and be taken out of sigma_s and sigma_t.")
    return [*lines, "misdirected: share of the light that goes to another angle.  reduced scattering: (1 - g) sigma_s.",
            "Polarisation, tables of multiple scattering and errors stay in the asset."]
