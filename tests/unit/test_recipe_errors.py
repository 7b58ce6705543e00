"""Every error names file, line, key, what was found and what would do; all at once, each once."""

import re

import pytest

from bakery.errors import RecipeError
from bakery.recipe import load

GOOD = """\
bakery: 1
name: fog
wavelengths: rgb
particles:
  host: air
  number_density: 1e8 /m^3
  components:
    - name: droplets
      material: water
      size: {distribution: lognormal, radius: 5 um, sigma: 1.5, min: 0.1 um, max: 60 um}
"""
MILK = "bakery: 1\nname: milk\nmedium:\n  albedo: 0.9\n  mean_free_path: 1 mm\n  phase: {type: hg, g: 0.7}\n"
TOP = ("bakery, name, description, wavelengths, seed, tolerance, measure, sweep, particles, grains, medium, phase, packing, "
       "scatterometer, effective_medium, multiple_scattering, beam, discrete or surface")


@pytest.fixture
def refuse(tmp_path, monkeypatch):
    """The problems of a recipe as lines without excerpts."""
    monkeypatch.chdir(tmp_path)

    def refuse(text):
        (tmp_path / "fog.yaml").write_text(text, encoding="utf-8")
        with pytest.raises(RecipeError) as error:
            load("fog.yaml")
        for problem in error.value.problems:
            if problem.column is not None:
                line, caret = problem.excerpt.splitlines()
                assert ("  " + text.splitlines()[problem.line - 1]).startswith(line) and len(caret) == problem.column + 2
        return [str(problem).partition("\n")[0] for problem in error.value.problems]

    return refuse


def test_the_message_of_the_contract(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fog.yaml").write_text(GOOD.replace("radius: 5 um", "radius: 5"))
    with pytest.raises(RecipeError) as error:
        load("fog.yaml")
    assert str(error.value) == (
        'fog.yaml:10: particles.components[0].size.radius: found "5", which has no unit; lengths take nm, um, mm, cm, m (5 um?)\n'
        "        size: {distribution: lognormal, radius: 5, sigma: 1.5, min: 0.1 um, max: 60 um}\n"
        "                                                ^"
    )
    assert error.value.exit_status == 2
    assert error.value.problems[0].as_dict() == {"file": "fog.yaml", "line": 10, "column": 47,
                                                 "key": "particles.components[0].size.radius",
                                                 "found": 'found "5", which has no unit',
                                                 "expected": "lengths take nm, um, mm, cm, m (5 um?)"}


@pytest.mark.parametrize(
    "old, new, says",
    [
        ("name: fog", "nmae: fog", [f'2: nmae: found the unknown key "nmae"; expected {TOP} (name?)']),
        ("bakery: 1\n", "", ["1: bakery: missing; expected bakery: recipe format"]),
        ("material: water", "material: watr",
         ['9: particles.components[0].material: found "watr", an unknown material; expected air, bk7, copper, dust, ice, '
          "nacl, quartz, silica, soot, vacuum, water, or {n: …, k: …}, or {file: …} (water?)"]),
        ("lognormal", "log-normal", ['10: particles.components[0].size.distribution: found "log-normal"; '
                                     "expected single, lognormal, gamma, junge, histogram, table or mixture (lognormal?)"]),
        (
            "distribution: lognormal, ",
            "",
            ["10: particles.components[0].size.distribution: missing; "
             "expected distribution: single, lognormal, gamma, junge, histogram, table or mixture"],
        ),
        ("sigma: 1.5", "sigma: 1",
         ['10: particles.components[0].size.sigma: found "1"; expected a number above 1 and at most 10, the geometric '
          "standard deviation"]),
        ("sigma: 1.5", "sigma: 1.5 um",
         ['10: particles.components[0].size.sigma: found "1.5 um"; expected a number without unit']),
        ("max: 60 um", "max: 0.1 um",
         ["10: particles.components[0].size.max: found max 0.1 um, not above min 0.1 um; expected min below max"]),
        ("min: 0.1 um, max: 60 um", "min: 5 mm, max: 6 mm",
         ["10: particles.components[0].size.min: found no particle between min and max (5000 to 6000 um); "
          "expected an interval with some of the distribution"]),
        ("lognormal, radius: 5 um, sigma: 1.5, min: 0.1 um, max: 60 um", "gamma, radius: 5 um, variance: 0.01, min: 50 um",
         ["10: particles.components[0].size.min: found no particle between min and max (50 to … um); "
          "expected an interval with some of the distribution"]),
        ("lognormal, radius: 5 um, sigma: 1.5, min: 0.1 um, max: 60 um",
         "mixture, max: 2 um, of: [{share: 50%, distribution: single, radius: 3 um}, "
         "{share: 50%, distribution: junge, exponent: 3, min: 4 um, max: 5 um}]",
         ["10: particles.components[0].size.max: found no particle between min and max (… to 2 um); "
          "expected an interval with some of the distribution"]),
        ("  number_density: 1e8 /m^3\n", "",
         ["4: particles: found no amount of particles; expected number_density, volume_fraction, volume_concentration or "
          "mass_concentration, here or in each component"]),
        ("  host: air", "  volume_fraction: 1%\n  host: air",
         ["5: particles.volume_fraction: found volume_fraction beside number_density; expected only one of them"]),
        ("1e8 /m^3", "0 /m^3",
         ['6: particles.number_density: found "0 /m^3"; expected a number density above 0 and at most 1e+30 /m^3']),
        ("number_density: 1e8 /m^3", "volume_fraction: 1",
         ['6: particles.volume_fraction: found "1"; expected a fraction above 0 and below 1']),
        ("wavelengths: rgb", "wavelengths: rbg",
         ['3: wavelengths: found "rbg"; expected rgb, visible8, a wavelength such as 5 um, or a list (rgb?)']),
        ("wavelengths: rgb", "wavelengths: [0.5, 0.6, 0.5]",
         ["3: wavelengths: found 0.5 um more than once; expected distinct wavelengths"]),
        ("wavelengths: rgb", "wavelengths: [0.5, -0.6]",
         ['3: wavelengths[1]: found "-0.6"; expected a wavelength at least 1e-09 and at most 1e+06 um']),
        ("wavelengths: rgb", "wavelengths: []", ["3: wavelengths: found 0 entries; expected at least 1"]),
        ("wavelengths: rgb", "wavelengths: [610, 550] nm\ntolerance: 60%",
         ['4: tolerance: found "60%"; expected a fraction at least 1e-06 and at most 0.5']),
        ("wavelengths: rgb", "wavelengths: [0.5, 2.0]",
         ['5: particles.host: found the wavelength 2 um, for which "air" has no data; expected 0.23 to 1.675 um',
          '9: particles.components[0].material: found the wavelength 2 um, for which "water" has no data; '
          "expected 0.2 to 1.125 um"]),
        ("host: air", "host: soot",
         ["5: particles.host: found a host that absorbs (k = 0.79); expected a clear host, k at most 0.001"]),
        ("material: water", "material: {n: 1.5, k: -0.1}",
         ['9: particles.components[0].material.k: found "-0.1"; expected a number at least 0 and at most 1000']),
        ("material: water", "material: {n: [1.5, 1.6]}",
         ["9: particles.components[0].material.n: found 2 values for 3 wavelengths; expected one value, or one a wavelength"]),
        ("material: water", "material: [1.5]",
         ["9: particles.components[0].material: found a list; expected the name of a material, {n: …, k: …}, {file: …} or "
          "{mixing: …, of: …}"]),
        ("host: air", "host: {n: 1.3, k: 0.1}", ['5: particles.host.k: found the unknown key "k"; expected n']),
        ("  components:\n    - name: droplets\n", "  components:\n      name: droplets\n",
         ["7: particles.components: found keys with values; expected a list"]),
        ("name: droplets", "name: theta",
         ['8: particles.components[0].name: found "theta", which the asset uses for its angles; expected another name']),
        ("{distribution: lognormal, radius: 5 um, sigma: 1.5, min: 0.1 um, max: 60 um}",
         "{distribution: gamma, radius: 5 um, variance: 0.4}",
         ['10: particles.components[0].size.variance: found "0.4"; expected a fraction at least 1e-06 and below 0.333333']),
        ("{distribution: lognormal, radius: 5 um, sigma: 1.5, min: 0.1 um, max: 60 um}",
         "{distribution: mixture, of: [{share: 0.5, distribution: single, radius: 5 um}, "
         "{share: 0.4, distribution: single, radius: 6 um}]}",
         ["10: particles.components[0].size.of: found shares that add up to 0.9; expected 1"]),
        ("particles:", "phase: {switch: 500}\nparticles:",
         ["4: phase.switch: found a size parameter for the switch to rays with another method than goa; "
          "expected method: goa beside it, or switch: auto"]),
        ("particles:", "phase: {method: goa, switch: 20}\nparticles:",
         ['4: phase.switch: found "20"; expected auto or a number at least 30 and at most 1e+08']),
        ("particles:", "phase: {radii: few}\nparticles:",
         ['4: phase.radii: found "few"; expected auto or a whole number from 3 to 1,000,000']),
        ("particles:", "phase: {edge: off}\nparticles:", ['4: phase.edge: found "off"; expected narrow, wide or none']),
        ("particles:", "phase: {method: mei}\nparticles:", ['4: phase.method: found "mei"; expected auto, mie or goa (mie?)']),
        ("particles:", "beam: {deep: 32}\nparticles:",
         ['4: beam.deep: found the unknown key "deep"; expected depth, tolerance or photons (depth?)']),
        ("particles:", "discrete: {count: 5}\nparticles:",
         ["4: discrete: found neither box nor mesh; expected one of them, such as box: [1 m, 1 m, 1 m]"]),
    ],
)
def test_particles(refuse, old, new, says):
    assert GOOD.count(old) >= 1
    assert refuse(GOOD.replace(old, new, 1)) == [f"fog.yaml:{line}" for line in says]


@pytest.mark.parametrize(
    "old, new, says",
    [
        ("albedo: 0.9", "albedo: 1.1", ['4: medium.albedo: found "1.1"; expected a fraction at least 0 and at most 1']),
        ("albedo: 0.9", "albedo: [0.9, 0.8]",
         ["4: medium.albedo: found 2 values for 3 wavelengths; expected one value, or one a wavelength"]),
        ("albedo: 0.9", "sigma_a: 0.9 /m", ["4: medium.sigma_a: found sigma_a beside mean_free_path; "
                                            "expected albedo and mean_free_path, or sigma_s and sigma_a"]),
        ("  albedo: 0.9\n", "",
         ["3: medium: found only mean_free_path; expected albedo and mean_free_path, or sigma_s and sigma_a"]),
        ("g: 0.7", "g: 1", ['6: medium.phase.g: found "1"; expected a number above -1 and below 1']),
        ("g: 0.7", "g: [0.5, 0.6, -1]", ['6: medium.phase.g[2]: found "-1"; expected a number above -1 and below 1']),
        ("{type: hg, g: 0.7}", "{type: gaussian, spread: 200 deg}",
         ['6: medium.phase.spread: found "200 deg"; expected an angle at least 5.72958e-05 and at most 180 deg']),
        ("g: 0.7}\n", "g: 0.7}\nsurface: {boundary: 1.3}\n",
         ['7: surface.boundary: found "1.3"; expected none, or {index: 1.33}']),
        ("{type: hg, g: 0.7}", "{type: table}",
         ["6: medium.phase.file: missing; expected file: CSV file with the columns theta_deg (or theta_rad), 0 to 180 degrees, "
          "and value (any scale)"]),
        ("medium:\n", "packing: {fraction: 0.5, radii: 3}\nmedium:\n",
         ["3: packing: found packing beside medium, which it has no effect on; expected it alone or with grains",
          '3: packing.radii: found "3"; expected equal, a list of {share, radius}, or {distribution: lognormal, sigma}']),
        ("{type: hg, g: 0.7}", "hg", ['6: medium.phase: found "hg"; expected keys with values, such as {type: hg, …}']),
        ("  albedo: 0.9\n  mean_free_path: 1 mm", "  sigma_s: 0 /m\n  sigma_a: 0 /m",
         ["3: medium: found sigma_s and sigma_a that are both 0; expected a positive sum"]),
        ("medium:", "phase: {polarized: true}\nmedium:",
         ["3: phase: found options of single scattering beside medium; expected them with particles only (medium.phase?)"]),
    ],
)
def test_medium(refuse, old, new, says):
    assert refuse(MILK.replace(old, new, 1)) == [f"fog.yaml:{line}" for line in says]


def test_everything_at_once_and_each_once(refuse):
    text = """\
bakery: 2
name: a/b
wavelenths: rgb
tolerance: 1 um
particles:
  number_density: 1e8
  components:
    - name: droplets
      material: watr
      fraction: 0.5
      size: {distribution: lognormal, radius: 5, sigma: 1.5, min: 3 um, max: 2 um}
    - name: droplets
      material: {file: nowhere.csv}
      fraction: 0.6
      size: {distribution: single, radius: 5 um}
"""
    lines = refuse(text)
    assert [line.split(": ")[:2] for line in lines] == [
        ["fog.yaml:1", "bakery"],
        ["fog.yaml:2", "name"],
        ["fog.yaml:3", "wavelenths"],
        ["fog.yaml:4", "tolerance"],
        ["fog.yaml:6", "particles.number_density"],
        ["fog.yaml:7", "particles.components"],
        ["fog.yaml:9", "particles.components[0].material"],
        ["fog.yaml:11", "particles.components[0].size.radius"],
        ["fog.yaml:11", "particles.components[0].size.max"],
        ["fog.yaml:12", "particles.components[1].name"],
        ["fog.yaml:13", "particles.components[1].material.file"],
    ]


def test_tables_name_their_own_lines(tmp_path):
    (tmp_path / "own.csv").write_text("# name: own\nwavelength_um,n,k\n0.4,1.3,0\n0.5,1.3\n0.6,-1.3,x\n")
    (tmp_path / "fog.yaml").write_text(GOOD.replace("material: water", "material: {file: own.csv}"))
    with pytest.raises(RecipeError) as error:
        load(tmp_path / "fog.yaml")
    assert [(p.file, p.line, p.column, p.key) for p in error.value.problems] == [
        ("own.csv", line, column, "particles.components[0].material.file") for line, column in ((4, 1), (5, 5), (5, 10))
    ]


# ---- what a number or a key may mean


@pytest.mark.parametrize(
    "old, new, says",
    [
        ("sigma: 1.5", "sigma: 0.4", "sigma: .*at most 10, the geometric standard deviation; exp[(]0.4[)] = 1.492 where"),
        ("wavelengths: rgb", "wavelengths: rgb\ntolerance: 2", "tolerance: .*at most 0.5 [(]2 %[?][)]$"),
        ("material: water", "material: water\n      fraction: 90", "fraction: .*at most 1 [(]90 %[?][)]$"),
        ("material: water", "material: water\n      fraction: 1.1", "fraction: .*at most 1$"),
        ("material: water", "material: water\n      fraction: 9000", "fraction: .*at most 1$"),
        ("material: water", "material: water\n      fraction: 90 um", "fraction: .*no unit of fraction"),
        ("material: water", "material: water\n      weight: 0.5", 'found the unknown key "weight"; .* [(]fraction[?][)]$'),
        ("number_density: 1e8 /m^3", "numberdensity: 1e8 /m^3", "numberdensity: found the unknown .* [(]number_density[?][)]$"),
        ("material: water", "materail: water", "materail: found the unknown .* [(]material[?][)]$"),
    ],
)
def test_one_message_says_what_may_be_meant(refuse, old, new, says):
    line, = refuse(GOOD.replace(old, new))
    assert re.search(says, line), line


def test_shares_of_grains_have_another_name_than_those_of_particles(refuse):
    """What would be false is not said beside it: that weights, by default 1, add up to 2."""
    grain = "    - {{name: {}, fraction: 0.5, shape: {{type: sphere}}, surface: {{type: diffuse, reflectance: 0.5}}}}\n"
    lines = refuse("bakery: 1\nname: sand\npacking: {fraction: 60%}\ngrains:\n  radius: 1 mm\n  components:\n"
                   + grain.format("a") + grain.format("b"))
    assert len(lines) == 2 and all('unknown key "fraction"' in line and line.endswith("(weight?)") for line in lines)


@pytest.mark.parametrize("listed", ["[1, 2, 3] 1/mm", "[1, 2, 3]1/mm", "[1, 2, 3] / mm", "[1, 2, 3] mm^-1",
                                    "[1,\n    2, 3] /mm  # c", "[1000, 2000, 3000] 1/m", '"[1, 2, 3] 1/mm"'])
def test_lists_with_units_of_one_over_a_length(tmp_path, listed):
    path = tmp_path / "milk.yaml"
    path.write_text(MILK.replace("albedo: 0.9\n  mean_free_path: 1 mm", f"sigma_s: 0 /m\n  sigma_a: {listed}"))
    assert load(path).medium.sigma_a.tolist() == [1000, 2000, 3000]


@pytest.mark.parametrize("listed", ["[1, 2, 3] per mm", "[1, 2, 3] 4", '["1", 2, 3] /mm'])
def test_what_else_may_stand_behind_a_list(refuse, listed):
    line, = refuse(MILK.replace("mean_free_path: 1 mm", f"mean_free_path: {listed}"))
    assert line.endswith('quote a list with its unit if in doubt: "[1, 2, 3] mm"')


def test_paths_stay_as_they_were_given(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wet").mkdir()
    (tmp_path / "wet" / "fog.yaml").write_text(GOOD.replace("radius: 5 um", "radius: 5"))
    for given in ("wet/fog.yaml", "./wet/fog.yaml", str(tmp_path / "wet" / "fog.yaml")):
        with pytest.raises(RecipeError) as error:
            load(given)
        assert str(error.value).startswith(f"{given}:10: ")


@pytest.mark.parametrize(("distribution", "words"), [
    ("lognormal, radius: 0.2 mm, sigma: 5.3",
     r"10: particles.components[0].size.sigma: found a tail in which radii up to 6.71e+09 um"),
    ("gamma, radius: 20 mm, variance: 0.3", r"10: particles.components[0].size.variance: found a tail in which radii up to"),
    ("mixture, of: [{share: 0.5, distribution: single, radius: 1 um},\n"
     "        {share: 0.5, distribution: lognormal, radius: 0.2 mm, sigma: 5.3}]",
     r"11: particles.components[0].size.of[1].sigma: found a tail in which radii up to"),
])
def test_a_tail_beyond_the_series_is_refused_with_the_cut_that_would_do(refuse, tmp_path, distribution, words):
    size = "lognormal, radius: 5 um, sigma: 1.5, min: 0.1 um, max: 60 um"
    (problem,) = refuse(GOOD.replace(size, distribution))
    assert problem.removeprefix("fog.yaml:").startswith(words), problem
    cut = problem.partition("a cut (")[2].partition(")")[0]
    path = tmp_path / "cut.yaml"
    path.write_text(GOOD.replace(size, f"{distribution}, {cut}"))
    load(path)


def test_a_table_of_sizes_counts_up_to_its_cut(refuse, tmp_path):
    (tmp_path / "sizes.csv").write_text("radius,density\n10,1\n1e9,1\n")
    size = "{distribution: lognormal, radius: 5 um, sigma: 1.5, min: 0.1 um, max: 60 um}"
    (problem,) = refuse(GOOD.replace(size, "{distribution: table, file: sizes.csv}"))
    assert "radius of 1e+09 um in the table, size parameter" in problem
    path = tmp_path / "cut.yaml"
    path.write_text(GOOD.replace(size, "{distribution: table, file: sizes.csv, max: 1 mm}"))
    load(path)


def test_a_law_as_narrow_as_rounding_has_no_tail(tmp_path):
    text = GOOD.replace("sigma: 1.5, min: 0.1 um, max: 60 um", "sigma: 1.0000000001")
    (tmp_path / "fog.yaml").write_text(text, encoding="utf-8")
    assert load(tmp_path / "fog.yaml").particles.components[0].size.max is None


@pytest.mark.parametrize("size", [
    "distribution: lognormal, radius: 5 um, sigma: 1.5, min: 6 um, max: 60 um",
    "distribution: lognormal, effective_radius: 5 um, sigma: 1.5, max: 3 um",
    "distribution: mixture, min: 4 um, max: 60 um, of: [{share: 10%, distribution: single, radius: 3 um}, "
    "{share: 90%, distribution: lognormal, radius: 0.5 um, sigma: 2}]",
])
def test_a_cut_may_leave_one_side_of_a_distribution_or_some_of_a_mixture(tmp_path, size):
    from bakery.physics.sizes import population
    from bakery.stages.optics.size_keys import sizes

    text = GOOD.replace("distribution: lognormal, radius: 5 um, sigma: 1.5, min: 0.1 um, max: 60 um", size)
    (tmp_path / "fog.yaml").write_text(text, encoding="utf-8")
    size = load(tmp_path / "fog.yaml").particles.components[0].size
    cut = population(sizes(size))
    assert cut.cumulative(size.max) == pytest.approx(1, rel=1e-12)
    assert cut.cumulative((size.min or 0.0) * (1 - 1e-12)) == 0
