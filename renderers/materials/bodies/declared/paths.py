"""Event by event, from the eye."""

from renderers.materials.bodies.declaration import BodyMethod


def slow(scene, assets, world) -> str:
    """What comes from points through glass is searched for from event to event."""
    filled = {entry.where.shape for entry in scene.values.materials}
    refracts = any(shape.name in filled and shape.index not in (None, 1.0) for shape in world.shapes())
    points = world.without_extent and refracts and all("multiple" in asset.stages for asset in assets)
    return "paths takes long for light of points behind boundaries" if points else ""


METHOD = BodyMethod(
    name="paths", words="event by event", exact=True, beside=True, slow=slow,
    brings="from the eye, event by event; lights are sampled at each event where the boundary is matched, and small "
           "lamps where it is of smooth glass")
