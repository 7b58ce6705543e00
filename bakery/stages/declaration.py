"""What a stage says of itself: the one declaration that plan, cache, documentation, `verify` and tests read.

A stage is a pure function from recipe values and upstream arrays to one group of the asset.  It writes no file, asks no
clock, and draws random numbers only from the streams of its context.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from html import escape
from importlib import import_module
from typing import Any, Protocol

import numpy as np

from bakery.draw.html import table
from bakery.errors import UsageError
from bakery.store.tree import Dataset, Group
from bakery.system.terminal import clean
from bakery.system.terminal import table as lines

ANY = (-math.inf, math.inf)  # `within` of what may be of either sign
SIGNED = (-1.0, 1.0)  # of cosines
MOST_ROWS = 30  # of an answer in a notebook


@dataclass(frozen=True)
class Output:
    """A dataset that the stage writes; `stages.conform` holds every asset to it."""

    path: str  # capital words stand for names of the recipe (`COMPONENT/radius`)
    # such as `(L, A)` or `(K + 1,)`: a letter is one length in all datasets of a group, or of what a capital word stands for; L
    # (wavelengths) and A (angles) are one length in the whole asset.  `(bytes,)` is text
    shape: str
    units: str
    description: str
    optional: bool = False
    choices: tuple[str, ...] = ()  # names of the values of an integer array
    # smallest and largest value; the largest may be a length, such as `V - 1`
    within: tuple[float, float | str] = (0.0, math.inf)
    whole: bool = False  # integers, as indices are
    scaled: bool = False  # may be integers, to be multiplied with powers of two that another dataset of the group holds


def datasets(outputs: Iterable[Output], values: Mapping[str, Any], prefix: str = "") -> dict[str, Dataset]:
    """Arrays as the datasets that a stage declares: units and descriptions stand in the declaration only.

    `values` maps names to arrays, `prefix` is the declared path before them (`COMPONENT/`).  A value that is not declared is a
    bug of the stage: KeyError.
    """
    declared = {output.path: output for output in outputs}
    return {name: Dataset(np.ascontiguousarray(data), declared[prefix + name].units, declared[prefix + name].description,
                          declared[prefix + name].choices) for name, data in values.items()}


@dataclass(frozen=True)
class RecipeSection:
    """A section that a stage adds to recipes."""

    name: str  # its key at the top of a recipe
    model: type  # keys, defaults, descriptions (`bakery.grammar.section.Section`)
    description: str  # one line for editors
    check: Callable[[Any, Any], None]  # (checker, mapping): what has to hold between keys; see `bakery.recipe.checker`
    # (parsed model, parsed recipe) -> model with the defaults that depend on the rest of the recipe
    completed: Callable[[Any, Any], Any] = lambda model, recipe: model
    scatters: bool = False  # whether it says what scatters; a recipe has exactly one such section
    alone: bool = False  # whether a recipe may have this section and nothing that scatters
    beside: str = ""  # a section beside which this one stands with its defaults where a recipe leaves it out


def own_tolerance(least: float) -> Callable[[Any, Any], Any]:
    """A `completed` of sections with a tolerance of their own: where they say none it is the recipe's, and at least so much."""
    return lambda model, recipe: model.model_copy(update={"tolerance": model.tolerance or max(recipe.tolerance, least)})


def later(target: str) -> Callable:
    """The function at a place, `bakery.stages.beam.pictures:pictures`, whose module is imported when it is first called."""
    module, _, name = target.partition(":")

    def called(*arguments):
        return getattr(import_module(module), name)(*arguments)

    return called


def _nothing(*_) -> tuple:
    return ()


@dataclass(frozen=True)
class Remark:
    """How a value that was asked for came about: a sentence, and the same as plain values for machines."""

    text: str
    values: tuple[Mapping[str, Any], ...] = ()


@dataclass(frozen=True)
class Answer:
    """A value that was asked for.

    Attributes
    ----------
    values : (...,) in `units`; one axis less for each argument that was a single value
    axes : (name, unit, coordinates) of each axis that is left; a position where there is no coordinate
    error : like `values`, absolute, standard error and bias together, where the asset has either of this array
    remarks : how the values came about
    """

    path: str
    units: str
    values: np.ndarray
    axes: tuple[tuple[str, str, np.ndarray], ...]
    error: np.ndarray | None
    remarks: tuple[Remark, ...] = ()

    def rows(self, number: Callable[[Any], str], figure: Callable[[Any, float | None], str] | None = None) -> Iterator[list[str]]:
        """Headings, then one row for each place of the last axis, `number` of each value; a single value is one row.

        The columns go over the axes before it: one a wavelength.

        figure : of a value and its error, None where it has none of its own, in place of `number`
        """
        quantity = f"{self.path.rpartition('/')[2]} [{self.units}]"
        figure = figure or (lambda value, error: number(value))
        *across, (name, unit, at) = self.axes or (("", "", None),)
        columns = [] if at is None else [(f"{name} [{unit}]", list(map(number, at)))]
        whole = (..., None) if at is None else ...
        values, error = self.values[whole], None if self.error is None else np.asarray(self.error)[whole]
        for index in np.ndindex(values.shape[:-1]):
            places = zip(across, index, strict=True)
            axes = ", ".join(f"index {i}" if name == "index" else
                              ("" if name == "wavelength" else f"{name} ") + f"{axis[i]:g} {unit}".removesuffix(" 1")
                              for (name, unit, axis), i in places)
            errors = [None] * len(values[index]) if error is None else error[index]
            columns.append((quantity + (f" at {axes}" if axes else ""), list(map(figure, values[index], errors))))
            if error is not None:
                columns.append((f"+- at {axes}" if axes else "+-", list(map(figure, errors, errors))))
        yield [head for head, _ in columns]
        for i in range(values.shape[-1]):
            yield [column[i] for _, column in columns]

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        return np.array(self.values, dtype, copy=copy)

    def _repr_html_(self) -> str:
        head, *rows = self._shown()
        return table(head, rows, 0) + "".join(f"<p>{escape(remark.text)}</p>\n" for remark in self.remarks)

    def __repr__(self) -> str:
        rows = [[clean(cell) for cell in row] for row in self._shown()]
        return "\n".join([*lines(rows, right=range(len(rows[0]))), *(f"# {clean(remark.text)}" for remark in self.remarks)])

    def _shown(self) -> list[list[str]]:
        """Headings and the first rows."""
        head, *rows = self.rows(lambda value: f"{value:.6g}" if value.dtype.kind == "f" else str(value))
        return [head, *(rows if len(rows) <= MOST_ROWS else [*rows[:MOST_ROWS], ["…"] * len(head)])]


@dataclass(frozen=True)
class Query:
    """A path of an asset that `bake query` answers with more than the array that is stored there."""

    path: str  # `multiple/point`
    arguments: Mapping[str, Any]  # name -> kind of its unit (`bakery.grammar.units`)
    example: str  # arguments as one would write them
    # (what `bakery.open` gives, path, arguments) -> Answer; UsageError where an argument is missing or has no effect
    answer: Callable[[Any, str, Mapping[str, Any]], Any]
    bare: bool = False  # whether it is answered without arguments too, and where nothing is stored at the path


def lists_of(path: str, arguments: Mapping[str, Any], accepted: Iterable[str], may: Iterable[str] = (),
             needed: Iterable[str] = (), example: str = "") -> list[str]:
    """Names of a query's arguments that are lists; UsageError where one has no effect, is needed, or may not be a list.

    may : names of those that may be lists;  example : all that is needed, as one would write it
    """
    if useless := [name for name in arguments if name not in accepted]:
        raise UsageError(f"{path}: {useless[0]} has no effect on it; {', '.join(accepted)} would")
    if missing := [name for name in needed if name not in arguments]:
        raise UsageError(f"{path}: {', '.join(missing)} missing; give {example}")
    several = [name for name in arguments if np.ndim(arguments[name])]
    if refused := [name for name in several if name not in may]:
        raise UsageError(f"{path}: {refused[0]} is a list; give one")
    if len(several) > 1:
        raise UsageError(f"{path}: {' and '.join(several)} are lists; only one may be")
    return several


@dataclass(frozen=True)
class Knob:
    """A setting that trades time for accuracy.

    `key` is the recipe key that sets it, `values` the settings that `bake trade` tries, as recipe texts from cheap to dear
    (`("10%", "3%", "1%")`); without values it is not tried.
    """

    name: str
    key: str
    default: Any
    description: str
    values: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cost:
    """What a stage is expected to take on this machine; `basis` says in words where the figures come from."""

    seconds: float  # of one core
    memory: float  # bytes, on top of the interpreter
    file: float  # bytes in the asset
    basis: str
    startup: float = 0.0  # seconds before the first block, whatever the number of cores: loading libraries and kernels
    remarks: tuple[str, ...] = ()  # choices that a user may want to know of before the work
    kernels: tuple[str, ...] = ()  # modules whose compiled kernels run, below `bakery`: mie.angular
    kind: str = ""  # of work: measured speeds of one kind say nothing of another
    most: float = math.inf  # cores that the work can use
    blocks: int = 0  # equal ones that the work consists of, `most` of which run at a time; 0: it divides into any number
    compiling: float = 0.0  # seconds that compiling these kernels adds on this machine, once; the plan finds out

    def cores(self, workers: int) -> float:
        """Cores of `workers` that are busy, on average over the work: 1.5 of two where there are three blocks."""
        if not self.blocks:
            return min(workers, self.most)
        whole, rest = divmod(self.blocks, int(self.most))
        return self.blocks / (whole * math.ceil(int(self.most) / workers) + math.ceil(rest / workers))


@dataclass(frozen=True)
class Result:
    """What `compute` returns: the group's members, the error reached in the stage's measure, remarks for the user.

    `missed` says in words which targets were missed although what was reached is worth storing; the bake then ends with status 3.
    """

    members: dict[str, Dataset | Group]
    achieved_error: float
    notes: tuple[str, ...] = ()
    missed: tuple[str, ...] = ()


class Context(Protocol):
    """What a running stage may ask of its surroundings."""

    tolerance: float
    seed: int

    def map(self, function: Callable, tasks: Sequence[tuple]) -> list:
        """`[function(*task) for task in tasks]`, on any number of workers, in the order of the tasks.

        `function` is importable by name and takes picklable arguments: it may run in another process or machine.
        """

    def report(self, fraction: float, error: float | None = None, state: str = "") -> None:
        """Share of the work that is done, 0 to 1, the error reached so far, the state of the work in the stage's own words."""


class Memory(Protocol):
    """Keeps what a stage decides, by content, between a plan and its bake; `bakery.run.cache.Cache` is one."""

    def get(self, name: str, key: str) -> tuple[Group, Group] | None:
        """The group kept under a key, and its provenance; None where there is none, or a damaged one."""

    def put(self, name: str, key: str, group: Group, provenance: Group) -> None:
        """Keep a group, whose attribute `input_hash` is the key."""


_memory: ContextVar[Memory | None] = ContextVar("memory", default=None)


@contextmanager
def remembering(memory: Memory) -> Iterator[None]:
    """Let stages keep what they decide meanwhile."""
    token = _memory.set(memory)
    try:
        yield
    finally:
        _memory.reset(token)


def memory() -> Memory | None:
    """Where a stage may keep what it decides; None: nowhere."""
    return _memory.get()


@dataclass(frozen=True)
class Stage:
    """Everything that others need to know of a stage.

    Attributes
    ----------
    name : the group that it writes, and its name on the command line (two stages may fill one group from different sources)
    version : raised in the commit that changes any stored value
    title : one line for plans and documentation
    reads : patterns of recipe keys (`particles.components[*].size.*`) that its values depend on, data files included
    needs : names of the stages whose groups it takes
    applies : whether a recipe asks for it
    outputs, knobs, error_measure : as stored
    together : paths of optional outputs, and of groups of them, of which there are all or none, for each that a capital word
        stands for
    cost : recipe -> Cost
    inputs : (recipe, upstream groups by name) -> arguments of `compute`, plain values and arrays
    compute : (inputs, context) -> Result
    check : group as declared and sound -> rules of its physics that it breaks, in words (normalisation, energy); `verify` and the
        store run it
    sound : group as declared -> broken rules that its readers count on (order, indices, room that a table takes), in words; quick
        and without heavy imports, for every `bakery.open` runs it
    view : root -> what `bakery.open` gives for the group; None: its members, as they are stored
    pictures : root -> `bakery.draw.picture.Picture` of all that is worth drawing
    tables : (root, path -> letters of the axes there) -> `bakery.draw.table.Table` for the page
    files : root -> (file name -> text, paths that these files tell): what `bake export --to csv` writes in a form of its own
    queries : paths that can be asked with arguments
    remarks : (root, path, letters of its axes, arguments) -> how a value there came about, as far as this stage knows: it is
        asked of every path
    rendered : whether `bake render` shows an asset by this group
    measures : (group, converged group) -> true errors by name, the one that settings are ranked by first; None where settings
        cannot be compared.  Errors are finite and in the unit of the tolerance
    reference : recipe key -> text: where the knobs stand for a converged group, besides the tolerance
    tolerance_key : recipe key of the error to be reached, where it is not the recipe's own
    sections : what it adds to recipes
    """

    name: str
    version: int
    title: str
    reads: tuple[str, ...]
    needs: tuple[str, ...]
    applies: Callable[[Any], bool]
    outputs: tuple[Output, ...]
    error_measure: str
    cost: Callable[[Any], Cost]
    inputs: Callable[[Any, Mapping[str, Group]], dict]
    compute: Callable[[dict, Context], Result]
    check: Callable[[Group], Iterable[str]]
    knobs: tuple[Knob, ...] = field(default=())
    measures: Callable[[Group, Group], Mapping[str, float]] | None = None
    reference: Mapping[str, str] = field(default_factory=dict, hash=False)
    tolerance_key: str = "tolerance"
    sections: tuple[RecipeSection, ...] = ()
    together: tuple[tuple[str, ...], ...] = ()
    sound: Callable[[Group], Iterable[str]] = _nothing
    view: Callable[[Group], Any] | None = None
    pictures: Callable[[Group], Iterable] = _nothing
    tables: Callable[[Group, Callable[[str], tuple[str, ...]]], Iterable] = _nothing
    files: Callable[[Group], tuple[Mapping[str, str], Iterable[str]]] = lambda root: ({}, ())
    queries: tuple[Query, ...] = field(default=(), hash=False)
    remarks: Callable[[Group, str, tuple[str, ...], Mapping[str, Any]], Iterable[Remark]] = _nothing
    rendered: bool = False

    def tolerance(self, recipe) -> float:
        """The error that the stage has to reach."""
        return recipe.tolerance if self.tolerance_key == "tolerance" else recipe.leaves[self.tolerance_key]
