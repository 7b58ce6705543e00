"""What the group `echo` can be asked."""

from bakery.stages.declaration import Answer
from bakery.stages.members import Members


class Echo(Members):
    """The group `echo`."""

    def louder(self, times: float):
        """The loudness of so many sounds at once, (L,)."""
        return times * self.loudness


def view(root) -> Echo:
    return Echo(root["echo"], "echo")


def louder(asset, path, arguments) -> Answer:
    return Answer(path, "1", asset.echo.louder(arguments["times"]), (("wavelength", "um", asset.wavelength),), None)
