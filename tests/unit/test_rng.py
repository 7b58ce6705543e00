"""Random streams: names and words are unique, numbers of one stream are no other's, nothing else draws numbers."""

import ast
import functools
import itertools

import numpy as np
import pytest

from bakery import rng
from tests.conftest import ROOT

SOURCES = sorted(path for folder in ("bakery", "renderers", "tests/oracles") for path in (ROOT / folder).rglob("*.py"))


def test_words_are_unique_and_of_32_bits():
    words = [stream.word for stream in rng.STREAMS.values()]
    assert len(set(words)) == len(words)
    assert all(0 < word < 2**32 for word in words)


def indices(stream):
    return [(0,) * len(stream.index), *(tuple(int(i == k) for i in range(len(stream.index))) for k in range(len(stream.index)))]


def test_no_two_streams_share_their_numbers():
    # seeds that differ in the upper word alone, and one that an index could be mistaken for
    seeds = 0, 1, 2**32, 2**32 + 1, 5 * 2**32 + 7, 2**53
    first = {}
    for (name, stream), seed in itertools.product(rng.STREAMS.items(), seeds):
        for index in indices(stream):
            first.setdefault(int(rng.generator(seed, name, *index).integers(2**63)), []).append((name, seed, index))
    assert all(len(who) == 1 for who in first.values()), [who for who in first.values() if len(who) > 1]


def test_a_large_seed_is_not_an_index():
    assert rng.generator(5 * 2**32 + 7, "multiple.photons", 0).random() != rng.generator(7, "multiple.photons", 5).random()


def test_wavelengths_of_neighbouring_seeds_differ():
    assert rng.generator(0, "beam.photons", 1, 0).random() != rng.generator(1, "beam.photons", 0, 0).random()


@pytest.mark.parametrize("seed, name, index", [(-1, "shapes", (0,)), (2**64, "shapes", (0,)), (0, "shapes", ()),
                                               (0, "shapes", (1, 2)), (0, "shapes", (-1,)), (0, "shapes", (2**32,))])
def test_out_of_range(seed, name, index):
    with pytest.raises(ValueError, match=f"stream {name}"):
        rng.generator(seed, name, *index)


def test_keys_are_the_sequence_s_own():
    assert np.array_equal(rng.key(3, "granular.walk"), rng.sequence(3, "granular.walk").generate_state(2))


def calls(tree):
    return [node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            for node in ast.walk(tree) if isinstance(node, ast.Call)]


def test_nothing_else_makes_generators():
    makers = "default_rng", "SeedSequence", "Philox", "PCG64", "RandomState"
    for path in SOURCES:
        text = path.read_text()
        if path.name != "rng.py" and any(maker in text for maker in makers):
            made = set(makers) & set(calls(ast.parse(text)))
            assert not made, f"{path}: {made}; bakery.rng has every stream by name"


def test_every_stream_is_drawn_from():
    text = "".join(path.read_text() for path in SOURCES if path.name != "rng.py")
    assert not [name for name in rng.STREAMS if f'"{name}"' not in text]


def test_keys_of_64_bits_hold_both_words():
    high, low = rng.key(3, "render.walk", 5).tolist()
    assert int(rng.stream_key(3, "render.walk", 5)) == high * 2**32 + low


@functools.cache
def in_renderers():
    words = "hashed", "begin_streams", "stream_key", "PCG32", "seed"
    texts = {path: path.read_text() for path in sorted((ROOT / "renderers").rglob("*.py"))}
    return [(path, ast.parse(text)) for path, text in texts.items() if any(word in text for word in words)]


def test_renderers_begin_their_streams_by_name():
    """Hashes are numbers of a stream's own; where one begins, its key is made of a name of the list, written there or by whoever
    gives the `key`."""
    begun = []
    for path, tree in in_renderers():
        for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and "hashed" in calls(node)):
            # which blocks a pass takes is no chance: each is taken in turn
            known = "begin_streams", "_branch", "uniform", "_blocks_in_view"
            assert function.name in known, f"{path}: {function.name} draws numbers from a hash"
        for node in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            name, unnamed = calls(node)[0], f"{path}:{node.lineno} begins a stream without a name"
            if name == "stream_key":
                begun.append(node.args[1].value)
            elif name in ("begin_streams", "streams"):
                assert ast.unparse(node.args[0]) == "key" or calls(node)[1:2] == ["stream_key"], unnamed
            elif name == "PCG32":  # of nothing but how many, the same ones each time
                assert len(node.args) + len(node.keywords) > 1, unnamed
    assert {name for name in rng.STREAMS if name.startswith("render.")} == set(begun) and len(begun) == len(set(begun))


def offsets(tree):
    """Where other random numbers come of sums or products of seeds, or of numbers of passes beside seeds."""
    for node in ast.walk(tree):
        terms = [node.left, node.right] if isinstance(node, ast.BinOp) else [*node.args] if isinstance(node, ast.Call) else []
        seeded = not {"seed", "self._seed"}.isdisjoint(map(ast.unparse, terms))
        if isinstance(node, ast.Call):
            seeded = (seeded or calls(node)[0] == "stream_key") and any(
                isinstance(term, ast.BinOp) and "number" in ast.unparse(term) for term in terms)
        if seeded or isinstance(node, ast.AugAssign) and ast.unparse(node.target) == "number":
            yield ast.unparse(node)


def test_renderers_add_nothing_to_seeds_and_passes():
    for noticed in ("begin(2**31 + number, self._seed)", "begin(3 * seed + 1)", "number += 5", "stream_key(0, 'a', 7 * number)"):
        assert list(offsets(ast.parse(noticed)))
    for path, tree in in_renderers():
        assert not list(offsets(tree)), f"{path}: {list(offsets(tree))}; a name and an index of `bakery.rng.STREAMS` would do"
