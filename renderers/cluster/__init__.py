"""Pictures on the workers of a Dask cluster (`bakery.run.dask`).

Workers need not see the files of a scene: these come with the work, as bytes (`files`).  What decides a picture is decided by the
process that asks for it: assets, methods, the variant of Mitsuba, the order in which passes are added up.
"""
