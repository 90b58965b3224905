"""Samples of every kind through a whole study: the same dataset from memory and zarr, and from a later call."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import rbd
from rbd.studies import table


def size(**given: Any) -> dict[str, float]:
    """A number that depends on all numbers given."""
    return {"value": float(sum(np.sum(x) for x in given.values() if isinstance(x, int | float | np.ndarray)))}


def kinds() -> dict[str, Any]:
    """Samples of many kinds."""
    box = rbd.testing.box(mass=1.0)
    toe, heel = (rbd.PointContact(name, "box") for name in ("toe", "heel"))
    feet = [[toe], [toe, heel]]
    axes = {"friction": [0.1, 0.2], "push": {"ahead": (1, 0, 0), "aside": (0, 1, 0)}, "law": ["x", "y"]}
    cases = table({"case": ["p", "q"], "place": [[1.0, 2.0], [3.0, 4.0]]}, dimension="case")
    return {
        "fixed arguments": rbd.grid(**axes, robot=box, margin=3).with_units(push="N", friction="1"),
        "objects": rbd.grid(feet=feet, contact={0.1: toe, 0.2: heel}, what=[None, 0.5, "free"], on=[True, False]),
        "one sample": rbd.grid(a=3.0, law="x"),
        "draws": rbd.sample(7, a=(0, 1), law=["x", "y"], k=stats.randint(1, 5), mu={"ice": 0.1, "rubber": 0.9}),
        "a product": rbd.grid(a=[1, 2]) * rbd.sample(3, b=(0, 1)) * cases,
        "NaN": rbd.grid(a=[np.nan, 1.0]),
        "rows": [{"a": 1, "b": "x"}, {"a": 2, "b": "y"}],
        "vectors": rbd.grid(place=np.eye(3)),
    }


@pytest.mark.parametrize("kind", kinds())
def test_a_stored_study_has_the_samples_of_one_in_memory(kind: str, tmp_path: Path) -> None:
    """Coordinates, their order aside, labels, units: equal; the same call again computes nothing and gives the same."""
    samples, path = kinds()[kind], tmp_path / "push.zarr"
    memory = rbd.study(size, samples, executor=0, progress=False)
    assert memory.ok.values.all() and memory.value.size == len(rbd.studies.tables.samples_of(samples))
    for _ in range(2):
        stored = rbd.study(size, samples, executor=0, out=path, progress=False)
        assert stored.drop_attrs(deep=False).identical(memory.drop_attrs(deep=False)), (stored, memory)
    assert rbd.studies.open_study(path).equals(memory)


def test_arguments_that_are_the_same_in_all_samples_are_not_arrays() -> None:
    """A batched function gets arrays of what varies, and the rest as it is."""

    def batch(a: Any, b: Any, mu: float, law: str) -> dict[str, Any]:
        assert isinstance(mu, float) and law == "x"
        return {"value": a * mu + b}

    found = rbd.study(batch, rbd.grid(a=np.arange(600.0), b=[1, 2], mu=0.5, law="x"), batched=True, executor=0, progress=False)
    assert (found.value.values == np.arange(600.0)[:, None] * 0.5 + [1, 2]).all()
    assert found.mu.item() == 0.5 and found.law.item() == "x"


def test_a_generator_that_is_given_stays() -> None:
    """`rng` as an argument of the samples is theirs, and not the study's."""

    def draw(a: int, rng: Any) -> float:
        return float(rng) if isinstance(rng, int) else float(rng.random())

    given = rbd.study(draw, rbd.grid(a=[1, 2], rng=3), executor=0, progress=False)
    own = rbd.study(draw, rbd.grid(a=[1, 2]), executor=0, progress=False)
    assert given.value.values.tolist() == [3.0, 3.0] and len(set(own.value.values.tolist())) == 2


@pytest.mark.parametrize("name", ["place", "place_value", "mu", "case", "load"])
def test_results_do_not_take_the_names_of_samples(name: str) -> None:
    """Arguments that vary or not, their values beside labels, dimensions."""
    samples = rbd.grid(place=np.eye(3), mu=0.5) * table({"load": [1.0, 2.0]}, dimension="case")
    with pytest.raises(rbd.InputError, match=f"has the name '{name}'"):
        rbd.study(lambda place, mu, load: {name: 1.0}, samples, executor=0, progress=False)


def test_wrong_names_are_refused_before_any_work(tmp_path: Path) -> None:
    """Nothing is computed, and no store is made."""
    with pytest.raises(rbd.InputError, match="no parameter 'b'.*'a'"):
        rbd.study(lambda a: a, rbd.grid(b=[1]), executor=0, out=tmp_path / "x.zarr")
    with pytest.raises(rbd.InputError, match="2 values of a; 3 values of b"):
        rbd.study(size, {"a": [1, 2], "b": [1, 2, 3]}, executor=0, out=tmp_path / "x.zarr")
    assert not list(tmp_path.iterdir())
