"""Event by event, from the eye."""

from renderers.scene.declaration import SceneMethod

METHOD = SceneMethod(
    name="paths", kind="medium", words="event by event", exact=True, beside=True,
    brings="from the eye, event by event; lights are sampled at each event where the boundary is matched")
