"""Export to other software, with a report of what is lost.

`formats` declares each format and writes it; `mitsuba` is a scene fragment with a phase function on a regular grid, `csv` tables,
`hg` fits the lobes that renderers without tables take, `pbrt` and `openpbr` (MaterialX, USD) are media with one lobe, `blender`
with two (`mixture` is what they share), `tiles` and `grains` packed spheres and meshes.
"""
