"""Event by event, by chains of paths that stay where there is light."""

from renderers.materials.bodies.declaration import BodyMethod

METHOD = BodyMethod(
    name="metropolis", words="event by event, by chains of paths that stay where there is light", exact=True, metropolis=True,
    pilot=5.0,
    brings="as paths; those that bring light are followed again with numbers that differ a little (Metropolis's algorithm)")
