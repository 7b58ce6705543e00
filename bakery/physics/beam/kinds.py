"""What tables of narrow beams are made with and of: their names in assets and in `asset.beam.kernel`."""

MODELS = ("transport", "small-angle")
MEASURES = {"fluence": "radiance of all scattered light integrated over directions",
            "forward": "the same over the directions that go on forward, as photons are counted",
            "flux": "power that goes forward through a unit of area, as a surface across the beam receives it"}
