"""`bake trade SCENE`: error against time over the methods of a scene and their knobs, each a point.

First every point gets the same time, then the reference, then the points that may still be the quickest to the scene's tolerance.
Pictures and records stay beside the page: a later call goes on with them.
"""

import time
from collections.abc import Mapping

from bakery.draw.files import folder_filled
from bakery.errors import BakeryError, Interrupted, RecipeError, UsageError
from bakery.report import comparison as report
from bakery.scenes import methods as shared
from bakery.store.put import put
from bakery.trade import check_budget
from bakery.trade import methods as curves
from renderers.pictures import comparison, differences
from renderers.scene import load
from renderers.scene.budget import DEFAULT
from renderers.scene.common import value_at

# of the budget: for all points together at first, and for the reference; what is left is for those that may be the quickest
_FIRST, _REFERENCE = 0.3, 0.3
# of the tolerance: noise of a point, with which its error is known well enough, and of the reference
_NOISE, _LEAST_NOISE = 0.5, 0.25


def trade(source, output, names: str | None, settings: Mapping[str, str], seed, budget: float, progress, *,
          overwrite=False) -> dict:
    """Measures the points of a scene, and writes the page.

    Parameters
    ----------
    output : path of the page, or None
    names : of the points as `bake compare --methods` takes them, or None: those that the renderer declares
    settings : dotted key -> value as text
    seed : of the passes, or None
    budget : minutes, of the clock
    overwrite : replace also files of other kinds

    Returns
    -------
    found : dict, what `--json` prints

    Raises
    ------
    UsageError, RecipeError : something is wrong with the call, or the scene
    BakeryError : no point that may be the reference could be rendered
    """
    check_budget(budget)
    loaded = load(source, settings)
    page = shared.page_at(output, loaded, "trade")
    jobs, refused = _jobs(loaded, names, page.with_suffix(""), settings, seed)
    shared.check(page, jobs, loaded.inputs, overwrite)
    sweep = _Sweep(jobs, loaded, 60 * budget, progress, overwrite, refused)
    with folder_filled(page.with_suffix("")):
        sweep.run()
    return sweep.written(page)


def _jobs(loaded, names, folder, settings, seed):
    """Jobs, and the points that the scene refuses with what it says; the scene's own method is one of the points."""
    rules, refused = loaded.rules, {}
    if names is not None:
        named = shared.split(names)
        if not set(named) & set(rules.EXACT):
            named.insert(0, rules.EXACT[0])
        return comparison.jobs(loaded.path, named, folder, settings, seed), refused
    jobs = []
    chosen = value_at(loaded.values, rules.CHOICE[0])  # None where materials have different ones
    for name in dict.fromkeys([*rules.POINTS, *([chosen] if chosen else [])]):
        try:
            jobs += comparison.jobs(loaded.path, [name], folder, settings, seed)
        except RecipeError as error:
            refused[name] = error.problems[0].found
    return jobs, refused


class _Sweep:
    """The points of a scene while they are measured."""

    def __init__(self, jobs, loaded, budget, progress, overwrite, refused):
        self.jobs, self.loaded, self.budget, self.progress = jobs, loaded, budget, progress
        self.overwrite, self.refused = overwrite, refused
        self.tolerance = loaded.values.tolerance or DEFAULT
        self.made, self.failed = {}, {}

    def run(self):
        """Renders what the budget allows; of what is begun two passes, however long they take."""
        begin = time.monotonic()
        # first those that may be the reference: without one nothing else is worth its time
        exact = [job for job in self.jobs if job.name in self.loaded.rules.EXACT]
        for job in [*exact, *(job for job in self.jobs if job not in exact)]:
            if job not in exact and time.monotonic() - begin > self.budget and not job.record.exists():
                self.refused[job.name] = "the budget was spent before; the same call goes on with it"
                continue
            self._draw(job, _NOISE, _FIRST * self.budget / len(self.jobs))
            if exact and job is exact[-1]:
                self._whole()
        self.reference = self._reference()
        self._draw(self.made[self.reference].job, _LEAST_NOISE, _REFERENCE * self.budget)
        self._compare(with_flip=False)
        names = curves.contenders(self.curves, self.tolerance)
        names = list(dict.fromkeys([*names, self.reference])) if names else []  # its noise hides errors as theirs does
        remaining = self.budget - sum(picture.clock for picture in self.made.values())
        for name in names if remaining > 0 else ():
            self._draw(self.made[name].job, _LEAST_NOISE, self.made[name].clock + remaining / len(names))
        with self.progress.during("measuring differences"):
            self._compare(with_flip=True)

    def _draw(self, job, noise, seconds):
        try:
            self.made[job.name] = shared.made(job, self.progress, comparison.measured, noise * self.tolerance, seconds,
                                              overwrite=self.overwrite)
        except Interrupted:
            raise
        except BakeryError as error:
            self.failed[job.name] = error

    def _whole(self) -> list:
        """What was made by methods without an error of their own.

        Raises UsageError where all of them leave light out.
        """
        exact = [rendered for name, rendered in self.made.items() if name in self.loaded.rules.EXACT]
        whole = [rendered for rendered in exact if not rendered.report.get("left_out")]
        if exact and not whole:
            raise UsageError(f"{self.loaded.path}: every method leaves light out, so none is a reference for errors: "
                             f"{'; '.join(exact[0].report['left_out'])}")
        return whole

    def _reference(self) -> str:
        """Name of the method without an error of its own whose picture is best: by the time that it takes, or, where a call
        before has given one the time of a reference, by its noise."""
        exact = self._whole()
        if not exact:
            for name in self.loaded.rules.EXACT:
                if name in self.failed:
                    raise self.failed[name]
            exact = " or ".join(self.loaded.rules.EXACT)
            raise UsageError(f"{self.loaded.path}: refuses {exact}, against which errors are taken: "
                             f"{', '.join(self.refused.values())}")
        ready = [picture for picture in exact if picture.clock >= 0.8 * _REFERENCE * self.budget
                 or (picture.report["noise"] or 0.0) <= _LEAST_NOISE * self.tolerance]
        best = min(ready or exact, key=lambda picture: (picture.report["noise"] or 0.0) if ready else picture.pace.rate)
        return best.job.name

    def _compare(self, with_flip):
        """Numbers, curves and what they say, of the pictures that are there."""
        pictures_made = sorted(self.made.values(), key=lambda picture: picture.job.name != self.reference)
        pictures = [differences.read(picture.job.pair[1], picture.job.name) for picture in pictures_made]
        for picture in pictures:
            differences.same_size(picture, pictures[0], self.reference)
        self.found = differences.compared(pictures, pictures[0], dict(self.loaded.values.display), with_flip=with_flip)
        self.summary = shared.summary(pictures_made, self.found, pictures[0])
        self.curves = shared.curves(self.summary)
        self.summary["trade"] = curves.compared(self.curves, self.tolerance) if self.curves else None

    def written(self, page) -> dict:
        """The summary, its page written: with the pictures of the reference, the front, the advised point and the next one."""
        summary, trade = self.summary, self.summary["trade"]
        refused = self.refused | {name: str(error) for name, error in self.failed.items()}
        summary |= {"budget": self.budget / 60, "refused": refused,
                    "as_it_stands": value_at(self.loaded.values, self.loaded.rules.CHOICE[0])}
        summary["remarks"] += [f"Not rendered: {name}: {why}" for name, why in refused.items()]
        names = {self.reference, *(front(trade) if trade else ())}
        best = trade["advised"] if trade else None
        names |= {best["name"], *([best["next"]["name"]] if best["next"] else ())} if best else set()
        shown, limit = shared.shown([method for method in self.found if method.name in names])
        text = report.page(summary, shown, limit, shared.drawing(self.curves, trade["knee"]) if trade else None,
                           title="error against time")
        put(page, text)
        return summary | {"page": str(page), "bytes": len(text.encode())}


def front(trade) -> list[str]:
    """Names of the points on the front, the quickest first."""
    return list(dict.fromkeys(entry["name"] for entry in trade["ranges"]))
