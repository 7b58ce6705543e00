"""What pbrt-v4 makes of a scene's text, as far as media need it: tokens, directives, parameters, spectra.

Written from the rules of its parser.cpp (tokens, numbers, parameter lists), paramdict.cpp (types, spectra, unused parameters)
and media.cpp (what a homogeneous medium takes).  `Refused` is raised where pbrt stops with an error.
"""

import re
from dataclasses import dataclass

import numpy as np

BARE = {"AttributeBegin", "AttributeEnd", "WorldBegin"}
LISTED = {"MakeNamedMedium", "MakeNamedMaterial", "Material", "Shape", "LightSource", "Camera", "Film", "Integrator",
          "Sampler"}  # "name", parameters
TYPES = {"bool", "float", "integer", "point2", "vector2", "point3", "vector3", "normal", "string", "texture", "rgb", "spectrum",
         "blackbody"}
HOMOGENEOUS = {"preset": "string", "sigma_a": "spectrum", "sigma_s": "spectrum", "Le": "spectrum", "Lescale": "float",
               "scale": "float", "g": "float"}
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
ESCAPES = dict(zip("bfnrt\\'\"", "\b\f\n\r\t\\'\"", strict=True))


class Refused(Exception):
    """pbrt would stop here."""


@dataclass(frozen=True)
class Quoted:
    """A token in quotation marks."""

    text: str


def tokens(text: str) -> list:
    """Words and brackets as str, strings as `Quoted`; comments are left out.

    A `#` begins a comment only where a token may begin: words go on to the next space, quotation mark or bracket.
    """
    found, at = [], 0
    while at < len(text):
        if text[at] in " \n\t\r":
            at += 1
        elif text[at] == "#":
            at = min((end for end in (text.find("\n", at), text.find("\r", at)) if end >= 0), default=len(text))
        elif text[at] in "[]":
            found.append(text[at])
            at += 1
        elif text[at] == '"':
            string, at = _string(text, at + 1)
            found.append(Quoted(string))
        else:
            begin = at
            while at < len(text) and text[at] not in ' \n\t\r"[]':
                at += 1
            found.append(text[begin:at])
    return found


def _string(text: str, at: int) -> tuple[str, int]:
    """The string that begins at a place, and the place behind its closing mark."""
    found = ""
    while at < len(text) and text[at] not in '"\n':
        if text[at] == "\\":
            at += 1
            if text[at:at + 1] not in ESCAPES or not text[at:at + 1]:
                raise Refused("escape")
            found += ESCAPES[text[at]]
        else:
            found += text[at]
        at += 1
    if at == len(text) or text[at] == "\n":
        raise Refused("string without an end")
    return found, at + 1


def number(word: str) -> float:
    """A number; nan, inf and what follows a number are none."""
    if not NUMBER.fullmatch(word):
        raise Refused(f"{word}: expected a number")
    return float(np.float32(word))


def parameters(words: list, at: int) -> tuple[dict, int]:
    """`"type name" value` or `"type name" [ value … ]`, any number of them: name -> (type, values), and the place behind."""
    found = {}
    while at < len(words) and isinstance(words[at], Quoted):
        parts = [part for part in re.split(r"[ \t]+", words[at].text) if part]
        if len(parts) < 2 or parts[0] not in TYPES:
            raise Refused(f"{words[at].text}: no type, or no name")
        at += 1
        if words[at:at + 1] == ["["]:
            end = words.index("]", at) if "]" in words[at:] else None
            if end is None:
                raise Refused("no closing bracket")
            values, at = words[at + 1:end], end + 1
        else:
            values, at = words[at:at + 1], at + 1
        if not values:
            raise Refused("no value")
        if len({type(value) for value in values}) > 1 or "[" in values:
            raise Refused("values of several kinds")
        strings = isinstance(values[0], Quoted)
        if strings != (parts[0] in ("string", "texture")) and not (strings and parts[0] == "spectrum"):
            raise Refused(f"{parts[0]} of another kind")
        found[parts[1]] = (parts[0], [value.text if strings else number(value) for value in values])
    return found, at


def directives(text: str) -> list[tuple]:
    """(directive, strings, parameters) each."""
    words, at, found = tokens(text), 0, []
    while at < len(words):
        word = words[at]
        at += 1
        names, given = [], {}
        if word in LISTED or word in ("MediumInterface", "Include"):
            while at < len(words) and isinstance(words[at], Quoted) and len(names) < (2 if word == "MediumInterface" else 1):
                names.append(words[at].text)
                at += 1
            if not names:
                raise Refused(f"{word}: expected a string")
            if word in LISTED:
                given, at = parameters(words, at)
        elif word not in BARE:
            raise Refused(f"unknown directive {word}")
        found.append((word, names, given))
    return found


def spectrum(parameter, nm):
    """Values at wavelengths: linear between the pairs, 0 outside of them."""
    kind, values = parameter
    given, values = values[::2], values[1::2]
    if kind != "spectrum" or len(given) != len(values) or np.any(np.diff(given) <= 0):
        raise Refused("pairs of ascending wavelength and value")
    return np.interp(nm, given, values, left=0.0, right=0.0)


def homogeneous(given: dict) -> dict:
    """Parameters of a homogeneous medium; one that it does not look for, or under another type, is an error."""
    if given.get("type") != ("string", ["homogeneous"]):
        raise Refused("medium unknown")
    rest = {name: value for name, value in given.items() if name != "type"}
    for name, (kind, values) in rest.items():
        if HOMOGENEOUS.get(name) != kind or kind == "float" and len(values) > 1:
            raise Refused(f"{name}: unused parameter")
    return rest
