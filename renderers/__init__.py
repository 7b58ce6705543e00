"""Renderers: each a thin folder that takes assets through `bakery.open` and makes pictures."""


def live(scene, output=None, **options):
    """An iterator over the pictures of a scene while it renders; the last one is written.

    Parameters, errors and how to stop it: `renderers.pictures.live.Pictures`.
    """
    from renderers.pictures.live import Pictures

    return Pictures(scene, output, **options)


render = live  # the plain name, for scripts that show no picture while it renders
