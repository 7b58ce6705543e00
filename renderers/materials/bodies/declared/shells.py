"""Event by event, with jumps through empty spheres."""

from renderers.materials.bodies.declaration import BodyMethod

METHOD = BodyMethod(
    name="shells", words="event by event, but far from surfaces light jumps", exact=True, spheres=True,
    pilot=4.0,
    brings="as paths, but far from surfaces light jumps to the surface of the largest empty sphere, by ends of walks "
           "stored before")
