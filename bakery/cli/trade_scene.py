"""What `bake trade SCENE` tells people."""

from collections.abc import Iterable, Mapping

from bakery.scenes.trade import front
from bakery.system.resources import duration
from bakery.system.terminal import table


def report(summary: Mapping) -> Iterable[str]:
    """Lines for people."""
    from bakery.report.comparison import difference_text, until_text

    trade = summary["trade"]
    if trade is None:
        yield f"{summary['name']}: fewer than two points with known noise"
        yield from summary["remarks"]
        return
    wanted = f"{100 * trade['tolerance']:.3g} %"
    base = next(method for method in summary["methods"] if method["name"] == summary["reference"])
    noise = f", noise {100 * base['noise']:.2g} %" if base["noise"] is not None else ""
    yield (f"{summary['name']}: {len(summary['methods'])} points against {base['name']} "
           f"({duration(base['processor'])}{noise}); times of all cores together")
    rows = [("", "point", f"to {wanted}", "error", "mean ratio", "noise", "after")]
    on_front, order = front(trade), trade["until"]
    for method in sorted(summary["methods"], key=lambda method: order.get(method["name"]) or float("inf")):
        error, _ = difference_text(method)
        different = method["difference"]
        ratio = f"{1 + different['bias']:.3f} +- {different['bias_error'] or 0:.3f}" if different else ""
        until = until_text(trade, method["name"]) or ("never" if method["name"] in trade["never"] else "hidden by noise")
        marks = ["front"] * (method["name"] in on_front) + ["as it stands"] * (method["name"] == summary["as_it_stands"])
        took = f" ({method['method']})" if method["name"] == "auto" and method["method"] != "auto" else ""
        rows.append((", ".join(marks), method["name"] + took, until,
                     "reference" if method is base else error, ratio,
                      "" if method["noise"] is None else f"{100 * method['noise']:.2g} %",
                     duration(method["processor"])))
    yield from ("  " + line for line in table(rows, right=range(2, len(rows[0]))))
    yield from ("  " + sentence for sentence in trade["advice"])
    if trade["advised"]:
        yield "  " + command(summary)
    yield from ("  " + remark for remark in summary["remarks"])


def command(summary: Mapping) -> str:
    """How to render what is advised; to what noise where figures and tolerance are of the same."""
    import shlex

    advised = summary["trade"]["advised"]
    method = next(method for method in summary["methods"] if method["name"] == advised["name"])
    settings = {key: value for key, value in (summary["overrides"] | method["overrides"]).items() if not key.startswith("stop")}
    if method["passes"] and summary["measure"] == "picture":
        settings["stop"] = f"{{noise: {100 * advised['noise']:.2g}%}}"
    return " ".join(["bake render", shlex.quote(method["scene"]),
                     *(f"--set {shlex.quote(f'{key}={value}')}" for key, value in settings.items())])
