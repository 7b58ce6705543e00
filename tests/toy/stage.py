"""Stage `echo`: the sum of a geometric series, one for each wavelength."""

import math

import numpy as np

from bakery.grammar.units import NUMBER_ONLY
from bakery.stages.declaration import Cost, Knob, Output, Query, Remark, Result, Stage, datasets, later
from tests.toy.section import ECHO

OUTPUTS = (Output("loudness", "(L,)", "1", "sum of all echoes, first sound included", within=(0, math.inf)),)


def _inputs(recipe, upstream) -> dict:
    return {"reflected": recipe.echo.reflected, "terms": recipe.echo.terms, "wavelength": recipe.wavelength}


def _compute(inputs, context) -> Result:
    share = inputs["reflected"] / np.array(inputs["wavelength"]) * min(inputs["wavelength"])
    terms = inputs["terms"] or max(1, math.ceil(math.log(context.tolerance) / math.log(max(share.max(), 1e-9))))
    context.report(1.0)
    return Result(dict(datasets(OUTPUTS, {"loudness": (1 - share**terms) / (1 - share)})), float(share.max() ** terms))


def _check(group):
    if (group["loudness"].data < 1).any():
        yield "loudness below that of the first sound"


def _measures(found, reference):
    return {"error": float(np.max(np.abs(found["loudness"].data / reference["loudness"].data - 1)))}


def _remarks(root, path, letters, arguments):
    return [Remark("echoes of a toy", ({"walls": 2},))] if path.startswith("echo/") else []


STAGE = Stage(
    name="echo",
    version=1,
    title="echoes between two walls",
    reads=("wavelengths", "tolerance", "echo"),
    needs=(),
    applies=lambda recipe: recipe.echo is not None,
    outputs=OUTPUTS,
    error_measure="share of the loudness that the cut series misses",
    cost=lambda recipe: Cost(0.01, 1e6, 1e3, "a sum"),
    inputs=_inputs,
    compute=_compute,
    check=_check,
    knobs=(Knob("terms", "echo.terms", "auto", "echoes that are added up", ("1", "4")),),
    measures=_measures,
    reference={"echo.terms": "auto"},
    sections=(ECHO,),
    view=later("tests.toy.view:view"),
    pictures=later("tests.toy.pictures:pictures"),
    tables=later("tests.toy.pictures:tables"),
    files=lambda root: ({"echo.txt": "heard\n"}, {"echo/loudness"}),
    queries=(Query("echo", {"times": NUMBER_ONLY}, "times=2", later("tests.toy.view:louder")),),
    remarks=_remarks,
)
