"""The only method that there is."""

from renderers.scene.declaration import SceneMethod

METHOD = SceneMethod(name="auto", kind="medium", words="paths", exact=True, candidates=("paths",), brings="as paths")
