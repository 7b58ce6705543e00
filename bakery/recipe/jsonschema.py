"""The JSON Schema of recipes: completion and hover texts in editors."""

from bakery.grammar import files
from bakery.recipe import schema, sweep

_MATERIAL = "ShippedMaterial"


def json_schema() -> dict:
    """The schema (draft 2020-12) as a dictionary; the same text in `assets/schemas/recipe-1.json`."""
    generated = schema.recipe_file().model_json_schema()
    generated["title"] = "Bakery recipe, format 1"
    sections = schema.sections()
    generated["anyOf"] = [{"oneOf": [{"required": [section.name]} for section in sections if section.scatters]},
                          *({"required": [section.name]} for section in sections if section.alone)]
    plain = _plain(generated)
    plain["$defs"] |= {_MATERIAL: {"enum": list(files.materials())}}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **plain}


def _plain(node):
    """Without pydantic's titles and nulls: a key that is absent is left out, not null."""
    if isinstance(node, list):
        return [_plain(item) for item in node]
    if not isinstance(node, dict):
        return node
    if node == {"enum": "materials"}:
        return {"$ref": f"#/$defs/{_MATERIAL}"}
    if "sweep" in node and node["sweep"] == "":
        return {**sweep.json_schema(), **{name: value for name, value in node.items() if name == "description"}}
    node = {
        key: _plain(value)
        for key, value in node.items()
        if not (key == "title" and isinstance(value, str) and "Bakery" not in value) and not (key == "default" and value is None)
    }
    choices = [item for item in node.get("anyOf", ()) if item != {"type": "null"}]
    if "anyOf" in node and len(choices) == 1:
        return {**{key: value for key, value in node.items() if key != "anyOf"}, **choices[0]}
    if "anyOf" in node:
        node["anyOf"] = choices
    return node
