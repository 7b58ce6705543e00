"""Fig. 11: how much of the scattered light is diffracted, and where."""

import numpy as np

from . import measures as of
from . import printed

RADII = (2.0, 10.0, 100.0, 1000.0)
BANDS = ((2, 5), (5, 10), (10, 20), (20, 45), (45, 90))  # degrees
FORMS = {"none": None, "eq. 4, cut at 90°": "printed", "tapered": "taper"}
M = 1.33


def share(radius, theta, form="printed"):
    """Diffracted part of the intensity by angle, log-normal: <|S_D|^2>/(<|S_D|^2> + <|S_rays|^2>), interference left out."""
    x, weight = of.log_normal(radius)
    s1, s2 = printed.amplitudes(M, x, theta, 3, diffraction=None)
    fan = weight @ printed.diffracted(x, theta, form) ** 2
    return fan / (fan + 0.5 * weight @ (abs(s1) ** 2 + abs(s2) ** 2))


def in_the_peak(radius):
    """Share of all scattered light inside the first dark ring of one sphere (3.832/x) by Mie, and that angle in degrees."""
    x = float(of.size_parameter(radius))
    theta = of.sphere_grid(x)
    light = of.exact(M, np.array([x]), np.ones(1), theta) * of.solid_angle(theta)
    return float(np.sum(light[theta < 3.832 / x]) / np.sum(light)), float(np.rad2deg(3.832 / x))


def band_errors(radius):
    """{form of diffraction: rms log10 in each of BANDS} of averaged patterns, rays of six orders; and the edge sum."""
    x, weight = of.log_normal(radius)
    theta = np.deg2rad(np.arange(2.05, 90, 0.1))
    exact = of.exact(M, x, weight, theta)
    patterns = {"+ edge": of.found("+ edge", M, x, weight, theta)}
    for name, form in FORMS.items():
        s1, s2 = printed.amplitudes(M, x, theta, 6, diffraction=form)
        patterns[name] = 0.5 * weight @ (abs(s1) ** 2 + abs(s2) ** 2)
    degrees = np.rad2deg(theta)
    return {name: [of.rms_log10(patterns[name][part], exact[part]) for a, b in BANDS for part in [(degrees >= a) & (degrees < b)]]
            for name in (*FORMS, "+ edge")}


def step_at_90(radius):
    """Jump of eq. 11 at 90 degrees: rms over sizes of the change of log10 intensity across the switch."""
    x, _ = of.log_normal(radius)
    s1, s2 = printed.amplitudes(M, x, np.pi / 2 + np.array([-1e-9, 1e-9]))
    light = abs(s1) ** 2 + abs(s2) ** 2
    return of.rms_log10(light[:, 0], light[:, 1])


def measure():
    theta = np.deg2rad(np.concatenate([np.geomspace(0.01, 1, 120), np.arange(1.05, 180, 0.25)]))
    shares = {(radius, form): share(radius, theta, form) for radius in RADII for form in ("printed", "taper")}
    half = {key: float(np.rad2deg(of.first_below(theta, value, 0.5))) for key, value in shares.items()}
    return dict(theta=theta, shares=shares, half=half, peak={radius: in_the_peak(radius) for radius in RADII},
                step={radius: step_at_90(radius) for radius in RADII},
                bands={radius: band_errors(radius) for radius in (10.0, 100.0)})


def tables(numbers):
    half, body = numbers["half"], []
    for radius in RADII:
        peak, angle = numbers["peak"][radius]
        body.append([f"{radius:g}", f"{100 * peak:.0f} %", of.short(angle), of.short(half[radius, "printed"]),
                     of.short(half[radius, "taper"]), of.short(numbers["step"][radius])])
    shares = of.table(["radius, µm", "scattered light inside the first dark ring (Mie)", "which ends at, degrees",
                       "diffraction is more than half up to, degrees: eq. 4", "tapered", "step of log10 intensity at 90°"], body)
    rows = [[f"{radius:g}", name, *(of.short(v) for v in row)]
            for radius, part in numbers["bands"].items() for name, row in part.items()]
    bands = of.table(["radius, µm", "diffraction; rms log10 in", *(f"{a}-{b}°" for a, b in BANDS)], rows)
    return {"fig11": shares + "\n\n" + bands}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.2, 3.6), width_ratios=(3, 2))
    degrees = np.rad2deg(numbers["theta"])
    for radius, colour in zip(RADII, ("#c99a06", "#c2410c", "#2a7fba", "#7b4fb5")):
        for form, line, words in (("printed", "-", "eq. 4"), ("taper", "--", "tapered")):
            left.semilogx(degrees, 100 * numbers["shares"][radius, form], line, color=colour, lw=1.2,
                          label=f"{radius:g} µm, {words}")
    left.set(xlabel="scattering angle, degrees", ylabel="diffracted share of the light, %", title="Water, log-normal",
             xlim=(0.01, 180))
    left.set_xticks([0.01, 0.1, 1, 10, 90], ["0.01", "0.1", "1", "10", "90"])
    left.legend(fontsize=8)
    place = np.arange(len(BANDS))
    for i, (name, colour) in enumerate(zip((*FORMS, "+ edge"), ("#9aa3ad", "#c2410c", "#c99a06", "#2b8a4b"))):
        right.bar(place + 0.2 * (i - 1.5), numbers["bands"][100.0][name], 0.19, color=colour,
                  label={"none": "no diffraction", "+ edge": "narrow edge"}.get(name, name))
    right.set_xticks(place, [f"{a}-{b}°" for a, b in BANDS])
    right.set(ylabel="rms log10 against Lorenz-Mie", title="Error at 100 µm")
    right.grid(axis="x", visible=False)
    right.legend(fontsize=8)
    return figure
