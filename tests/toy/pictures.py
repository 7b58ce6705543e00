"""The picture and the table of the group `echo`."""

from bakery.draw.picture import Picture
from bakery.draw.table import Table


def pictures(root):
    um, loudness = root["wavelength"].data, root["echo/loudness"].data

    def draw(figure):
        figure.subplots().plot(um, loudness)

    yield Picture("echo", "Echoes heard", "Loudness against wavelength.", (3.0, 2.0), draw,
                  (("wavelength [um]", um), ("loudness [1]", loudness)))


def tables(root, axes):
    assert axes("echo/loudness") == ("L",)
    yield Table("Echoes", ("loudness",), [[f"{value:.6g}"] for value in root["echo/loudness"].data], note="Heard twice.")
