"""What methods of scenes declare, and how they compare, for people."""


def declarations():
    """What each method of each kind of material declares, of JSON's types."""
    from renderers.scene.entries import KINDS, declared

    for kind in KINDS:
        for method in declared(kind).values():
            yield {"kind": kind, "name": method.name, "words": method.words, "brings": method.brings,
                   "leaves_out": method.leaves_out, "error": _error_text(method),
                   "chooses_from": list(method.candidates), "takes": list(method.keys)}


def declared_lines():
    """The same for people."""
    for method in declarations():
        yield f"{method.pop('kind')}, {method.pop('name')}: {method.pop('words')}"
        yield from (f"  {key.replace('_', ' ')}: {value if isinstance(value, str) else ', '.join(value)}"
                    for key, value in method.items() if value)


def _error_text(method) -> str:
    from renderers.scene import budget

    if method.exact:
        return "none of its own"
    texts = ["kept within a scene's tolerance"] if method.keeps else []
    if stated := method.error(budget.DEFAULT):
        texts.append(f"up to {budget.percent(stated)} is stated (at a tolerance of {budget.percent(budget.DEFAULT)})")
    if method.measured:
        texts.append("measured in the picture")
    return "; ".join(texts) or "neither stated nor measured"


def lines(summary) -> list[str]:
    """A summary for people, on standard error."""
    from bakery.report.comparison import difference_text

    text = []
    for method in summary["methods"]:
        error, bias = difference_text(method)
        words = ["reference"] if method["name"] == summary["reference"] else []
        words += [f"error {error}"] * bool(error) + [f"bias {bias}"] * bool(bias)
        words += [f"FLIP {method['flip']:.3f}"] if method["flip"] is not None else []
        words += [f"noise {100 * method['noise']:.2g} %"] if method["noise"] is not None else []
        words += [f"{method['seconds']['total'] - method['compiling']:.3g} s" + " (rendered before)" * method["taken"]
                  + " (rendered again: the earlier picture had other inputs)" * method["anew"]]
        text.append(f"{method['name']}: {', '.join(words)}")
    return text
