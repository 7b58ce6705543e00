"""The recipes of `recipes/catalogue` beside what their sources say of the same materials.

    python -m benchmarks.catalogue        bakes all of them and writes the tables of docs/catalogue.md
"""

import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from ruamel.yaml import YAML
from scipy.special import eval_legendre

import bakery
from benchmarks.claims import filled
from benchmarks.sizes import docs, sized

ROOT = Path(__file__).parents[1]
FOLDER, PAGE = ROOT / "recipes" / "catalogue", ROOT / "docs" / "catalogue.md"
UNITS = {"1": 1.0, "um^2": 1.0, "1/sr": 1.0, "1/m": 1.0, "1/mm": 1e3, "1/km": 1e-3}  # of the sources, in those of assets
LEAST = 1e-7  # a deviation below is one of rounding
KINDS = {"clouds and aerosols": ("Hess", "Garcia"), "ice and dust": ("Flanner", "Whicker"), "sea water": ("Petzold",),
         "snow": ("Wiscombe", "Warren"), "solids and foods": ("Jensen",),
         "liquids": ("Narasimhan",)}  # table of the page -> first authors


class Checked(NamedTuple):
    """One published figure beside the baked one, in the unit of the source; NaN where the source has no value."""

    figure: str
    at: str  # orders or angles, in words
    unit: str
    published: np.ndarray  # (L,), or one an order or angle
    baked: np.ndarray  # the same
    allowed: float
    relative: bool

    @property
    def off(self) -> float:
        """Largest deviation, relative or absolute as what is allowed is."""
        deviation = np.abs(self.baked - self.published) / (np.abs(self.published) if self.relative else 1.0)
        return float(np.nanmax(deviation))


def published() -> dict[str, dict]:
    """Recipe -> what `published.yaml` holds of it."""
    return YAML(typ="safe").load((FOLDER / "published.yaml").read_text(encoding="utf-8"))


def checked(asset, checks) -> list[Checked]:
    """The checks of one material, on its asset."""
    found = []
    for check in checks:
        values = np.array([np.nan if value is None else value for value in check["values"]], float)
        at = "".join(f", {key} {', '.join(map(str, check[key]))}" for key in ("orders", "angles") if key in check)
        found.append(Checked(check["figure"], at, check["unit"], values, _figure(asset, check) / UNITS[check["unit"]],
                             check.get("relative", check.get("absolute")), "relative" in check))
    return found


def _figure(asset, check) -> np.ndarray:
    if check["figure"] == "plane_albedo":
        return asset.surface.albedo(np.radians(check["angles"][0]))
    derived = DERIVED.get(check["figure"])
    return derived(asset.medium, check) if derived else np.ravel(asset.query(check["figure"]))


def diffuse_reflectance(albedo, index: float):
    """Share of diffuse light that a half space sends back, by the dipole approximation.

    albedo : (L,) reduced; index : of refraction, relative to outside, above 1.  Source: Jensen et al. 2001, eq. 15 and 16; the
    diffuse Fresnel reflectance is the polynomial of Egan & Hilgeman that they cite.
    """
    inside = -1.440 / index**2 + 0.710 / index + 0.668 + 0.0636 * index
    mismatch, decay = (1 + inside) / (1 - inside), np.sqrt(3 * (1 - albedo))
    return albedo / 2 * (1 + np.exp(-4 / 3 * mismatch * decay)) * np.exp(-decay)


def legendre(phase, orders) -> np.ndarray:
    """(2 l + 1) times the mean of P_l(cos theta) by the first row of a phase function, one an order l."""
    cosine, weight = np.polynomial.legendre.leggauss(4000)  # a peak of 1e-3 rad is 1,000 times wider than their distance there
    weight = 2 * np.pi * weight * phase(np.arccos(cosine))[0]
    return np.array([(2 * order + 1) * weight @ eval_legendre(order, cosine) for order in orders])


def _backscattered(medium) -> np.ndarray:
    return 1 - np.array([np.interp(np.pi / 2, medium.theta, row) for row in medium.cdf])


DERIVED = {
    "co_albedo": lambda medium, check: medium.sigma_a / medium.sigma_t,
    "reduced_scattering": lambda medium, check: (1 - medium.g) * medium.sigma_s,
    "diffuse_reflectance": lambda medium, check: diffuse_reflectance(np.asarray(medium.albedo_reduced), check["index"]),
    "legendre": lambda medium, check: legendre(medium.phase, check["orders"]),
    "phase": lambda medium, check: medium.phase(np.radians(check["angles"]))[0],
    "backscatter_fraction": lambda medium, check: _backscattered(medium),
}


def bake(name: str, folder) -> bakery.Asset:
    """The asset of a recipe of the catalogue."""
    return bakery.open(bakery.bake(FOLDER / f"{name}.yaml", output=Path(folder) / f"{name}.h5"))


def main() -> None:
    texts = {kind: ["| recipe | material | published (off by) |", "|---|---|---|"] for kind in KINDS}
    with tempfile.TemporaryDirectory() as folder:
        for name, about in list(published().items())[:sized(None, 3)]:
            kind = next(kind for kind, authors in KINDS.items() if about["source"].startswith(authors))
            texts[kind].append(_row(name, about, checked(bake(name, folder), about["checks"])))
            print(name, file=sys.stderr)
    page = docs() / PAGE.name
    page.write_text(filled(PAGE.read_text(encoding="utf-8"), {kind: "\n".join(rows) for kind, rows in texts.items()}, PAGE.name),
                    encoding="utf-8")


def _row(name: str, about: dict, found: list[Checked]) -> str:
    figures = []
    for one in found:
        unit = one.at + ("" if one.unit == "1" else f", {one.unit}")
        said = ", ".join("–" if np.isnan(v) else f"{v:.4g}" for v in one.published)
        off = one.off * (one.off > LEAST)
        off = f"{100 * off:.2g} %" if one.relative else f"{off:.2g}"
        figures.append(f"`{one.figure.rpartition('/')[2]}`{unit}: {said} ({off})")
    return f"| [`{name}`](../recipes/catalogue/{name}.yaml) | {about['about']} | {'<br>'.join(figures)} |"


if __name__ == "__main__":
    main()
