"""Grids, draws and tables: every sample once, in a fixed order, the same on every machine; what is wrong is said."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest
import sampled
import xarray
from scipy import stats

import rbd
from rbd.errors import InputError
from rbd.studies import Samples, table
from rbd.studies.draws import points
from rbd.studies.samples import arguments
from rbd.studies.tables import samples_of

SETTINGS = hypothesis.settings(derandomize=True, deadline=None, database=None, max_examples=60)


def rows(samples: Samples) -> list[dict[str, Any]]:
    """All samples, one after the other."""
    return list(arguments(samples.columns(0, len(samples))))


def same(one: Any, other: Any) -> bool:
    """Whether two columns are equal, in kind too; NaN equals NaN."""
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    return bool(one == other)


class Law:
    """A thing without a name of its own."""

    def __init__(self, mu: float) -> None:
        self.mu = mu


@dataclass(frozen=True)
class Terrain:
    """A thing with a name."""

    name: str
    height: float = 0.0


def test_a_grid_is_all_combinations_the_last_name_fastest() -> None:
    """As nested loops would give them; plain Python numbers, as functions want."""
    grid = rbd.grid(friction=[0.3, 0.6], facets=range(4, 10, 2), law=["convex", "coulomb"])
    loops = [{"friction": f, "facets": n, "law": law} for f in (0.3, 0.6) for n in (4, 6, 8) for law in ("convex", "coulomb")]
    assert rows(grid) == loops and len(grid) == 12 and dict(grid.dims) == {"friction": 2, "facets": 3, "law": 2}
    assert [grid.row(i) for i in range(12)] == loops and grid.row(-1) == loops[-1]
    assert all(type(x) is kind for x, kind in zip(grid.row(0).values(), (float, int, str), strict=True))
    assert grid.at(law="coulomb", friction=0.6, facets=6) == {"friction": 0.6, "facets": 6, "law": "coulomb"}


def test_a_grid_of_a_billion_samples_costs_as_much_as_its_axes() -> None:
    """No combination is in memory: 10^12 samples, of which any few are computed at once."""
    grid = rbd.grid(**{name: np.linspace(0.0, 1.0, 1000) for name in "abcd"})
    assert len(grid) == 10**12
    last = grid.columns(10**12 - 2, 10**12)
    assert last["d"].tolist() == [998 / 999, 1.0] and last["a"].tolist() == [1.0, 1.0]
    assert len(grid.digest()) == 64 and "1,000,000,000,000" in str(grid)
    with pytest.raises(InputError, match="fewer values"):
        rbd.grid(**{name: np.arange(1000) for name in "abcdef"})


AXES = st.one_of(
    st.lists(st.floats(), min_size=1, max_size=5, unique_by=lambda x: str(x + 0.0)),
    st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, max_size=5, unique=True),
    st.lists(st.text(min_size=1, max_size=3).filter(lambda x: "\0" not in x), min_size=1, max_size=4, unique=True),
    st.just([True, False]),
    st.just([None, 0.5, "free"]),
    st.sampled_from([0.5, "all", None]),
    st.just(np.arange(6.0).reshape(3, 2)),
)


@SETTINGS
@hypothesis.given(st.dictionaries(st.sampled_from("abcd"), AXES, min_size=1, max_size=4), st.data())
def test_parts_put_together_are_the_whole(axes: dict[str, Any], data: st.DataObject) -> None:
    """However samples are cut into chunks, and one by one: the same values; the digest does not change."""
    grid = rbd.grid(**axes)
    n = len(grid)
    cuts = sorted({0, n, *data.draw(st.lists(st.integers(0, n), max_size=4))})
    whole = grid.columns(0, n)
    parts = [grid.columns(a, b) for a, b in zip(cuts, cuts[1:], strict=False)]
    for name, values in whole.items():
        found = [part[name] for part in parts]
        assert same(values, np.concatenate(found) if isinstance(values, np.ndarray) else sum(found, []))
    fixed = grid.fixed
    for i, row in enumerate(arguments(whole)):
        assert repr(grid.row(i)) == repr({name: (row | fixed)[name] for name in grid.names})
    assert rbd.grid(**axes).digest() == grid.digest()
    coords = xarray.Dataset(coords=grid.coords()).coords
    assert set(grid.names) <= set(coords) and all(coords[dim].ndim == 1 for dim in grid.dims)


def test_every_change_of_a_grid_changes_its_digest() -> None:
    """Values, order, names, kinds, labels; but neither units nor the width of numbers."""
    one = rbd.grid(a=[1.0, 2.0], b=["x", "y"], c=3.0)
    others = [
        rbd.grid(a=[1.0, 2.0 + 1e-15], b=["x", "y"], c=3.0),
        rbd.grid(a=[2.0, 1.0], b=["x", "y"], c=3.0),
        rbd.grid(b=["x", "y"], a=[1.0, 2.0], c=3.0),
        rbd.grid(a=[1, 2], b=["x", "y"], c=3.0),
        rbd.grid(a=[1.0, 2.0], b=["x", "z"], c=3.0),
        rbd.grid(a=[1.0, 2.0], b=["x", "y"], c=[3.0]),
        rbd.grid(a=[1.0, 2.0], b=["x", "y"], d=3.0),
        rbd.grid(a={"p": 1.0, "q": 2.0}, b=["x", "y"], c=3.0),
        table({"a": [1.0, 2.0], "b": ["x", "y"], "c": 3.0}),
    ]
    assert len({x.digest() for x in (one, *others)}) == 10
    like = rbd.grid(a=np.array([1.0, 2.0], "f4"), b=np.array(["x", "y"], object), c=np.float32(3.0)).with_units(a="N")
    assert like.digest() == one.digest()
    assert rbd.grid(a=np.arange(3, dtype=">i2")).digest() == rbd.grid(a=range(3)).digest()


def test_a_digest_is_the_same_in_another_process() -> None:
    """Another order of hashes, other addresses; objects count by their content."""
    code = "import sampled; print([x.digest() for x in sampled.made()])"
    paths = f"{Path(__file__).parent}:{Path(rbd.__file__).parents[1]}"
    for_child = {"PYTHONHASHSEED": "1" if os.environ.get("PYTHONHASHSEED") != "1" else "2", "PYTHONPATH": paths}
    done = subprocess.run([sys.executable, "-c", code], env=for_child, capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == str([x.digest() for x in sampled.made()]), done.stderr


def test_objects_are_told_apart_by_their_content(tmp_path: Path) -> None:
    """A robot with another mass, a contact with another friction: another digest; the same again, wherever its file lies."""
    shutil.copy(Path(__file__).parents[2] / "urdf" / "box.urdf", tmp_path / "box.urdf")
    (tmp_path / "moved").mkdir()
    shutil.copy(tmp_path / "box.urdf", tmp_path / "moved" / "box.urdf")
    one, same = (rbd.load_robot(folder / "box.urdf") for folder in (tmp_path, tmp_path / "moved"))
    assert rbd.grid(robot=one).digest() == rbd.grid(robot=same).digest()
    same.model.inertias[1].mass *= 2.0
    assert rbd.grid(robot=one).digest() != rbd.grid(robot=same).digest()
    masses = [rbd.grid(robot=rbd.testing.box(mass=m)).digest() for m in (10.0, 11.0, 10.0)]
    assert masses[0] == masses[2] != masses[1]
    laws = [rbd.grid(x=[Law(mu)]).digest() for mu in (0.1, 0.2, 0.1)]
    assert laws[0] == laws[2] != laws[1]
    with (
        open(__file__) as file,
        pytest.raises(InputError, match=r"\['x'\].*is a _io.TextIOWrapper, which has no content.*Create it inside"),
    ):
        rbd.grid(x=[file]).digest()


def test_objects_have_their_names_as_labels() -> None:
    """Robots, contacts, lists of contacts, laws, functions, classes: what a reader of the dataset wants to see."""
    box = rbd.testing.box(mass=1.0)
    toe, heel = (rbd.PointContact(name, "box") for name in ("toe", "heel"))
    grid = rbd.grid(robot=[box], feet=[[toe], [toe, heel]], how=[rbd.solve, rbd.hold], law=[rbd.KKT(), None], kind=[Law, int])
    labels = {name: values.tolist() for name, (_, values, _) in grid.coords().items()}
    assert labels["robot"] == [box.name] and labels["feet"] == ["toe", "toe, heel"]
    assert labels["how"] == ["solve", "hold"] and labels["kind"] == ["Law", "int"]
    assert labels["law"] == [str(rbd.KKT()), "None"]
    assert grid.row(0)["robot"] is box and grid.at(robot=box, feet="toe, heel", how="hold", law=None, kind="int")
    assert [x.tolist() for _, x, _ in rbd.grid(law=[Law(1.0), Law(2.0)]).coords().values()] == [["Law 0", "Law 1"]]
    assert rbd.grid(law=Law(1.0)).coords()["law"][1] == "Law"  # no address


def test_labels_name_objects_numbers_and_vectors() -> None:
    """{label: value}: the coordinate has the labels; numbers and vectors stand beside it."""
    grid = rbd.grid(friction={"ice": 0.05, "rubber": 0.9}, push={"ahead": (9, 0, 0), "aside": (0, 9, 0)}).with_units(push="N")
    found = xarray.Dataset(coords=grid.coords())
    assert found.friction.values.tolist() == ["ice", "rubber"] and found.friction_value.values.tolist() == [0.05, 0.9]
    assert found.push_value.dims == ("push", "push_0") and found.push_value.attrs == {"units": "N"}
    row = grid.at(push="aside", friction="rubber")
    assert row["friction"] == 0.9 and row["push"].tolist() == [0, 9, 0]
    one = rbd.grid(contact={0.1: Terrain("flat"), 0.2: Terrain("flat")})
    assert one.coords()["contact"][1].tolist() == [0.1, 0.2] and one.at(contact=0.2)["contact"] == Terrain("flat")
    drawn = rbd.sample(8, friction={"ice": 0.05, "rubber": 0.9}, method="random", seed=1)
    pairs = set(zip(*(drawn.coords()[name][1].tolist() for name in ("friction", "friction_value")), strict=True))
    assert pairs == {("ice", 0.05), ("rubber", 0.9)}


def test_vectors_vary_along_their_first_axis() -> None:
    """Of a grid they are numbered; in a table they are coordinates with a dimension more."""
    pushes = np.arange(6.0).reshape(2, 3)
    grid, rows_of = rbd.grid(push=pushes), table({"push": pushes, "mu": [0.1, 0.2]})
    assert grid.columns(0, 2)["push"].tolist() == pushes.tolist() and grid.row(1)["push"].tolist() == [3.0, 4.0, 5.0]
    assert grid.coords()["push"][1].tolist() == [0, 1] and grid.coords()["push_value"][0] == ("push", "push_0")
    assert rows_of.coords()["push"][0] == ("sample", "push_0") and rows_of.coords()["sample"][1].tolist() == [0, 1]
    assert grid.at(push=1)["push"].tolist() == [3.0, 4.0, 5.0]


def test_who_changes_what_is_given_changes_no_sample() -> None:
    """Arrays are new ones each time: of a chunk, and of one sample."""
    for samples in (rbd.grid(push=np.eye(3)), table({"push": np.eye(3)}), rbd.grid(push=np.eye(3), a=[1])):
        before = samples.digest()
        samples.columns(0, 3)["push"][:] = 7.0
        samples.coords()["push"][1][:] = 7
        samples.row(1)["push"][:] = 7.0
        next(arguments(samples.columns(0, 3)))["push"][:] = 7.0
        assert samples.digest() == before


def test_one_value_is_the_same_in_all_samples() -> None:
    """Not a dimension of length one, but a coordinate without a dimension; it is not sent with every chunk."""
    box = rbd.testing.box(mass=1.0)
    grid = rbd.grid(friction=[0.3, 0.6], robot=box, law="convex", margin=np.float64(0.1))
    assert dict(grid.dims) == {"friction": 2} and set(grid.columns(0, 2)) == {"friction"}
    assert grid.fixed == {"robot": box, "law": "convex", "margin": 0.1} and grid.row(1)["robot"] is box
    found = xarray.Dataset(coords=grid.coords())
    assert found.law.item() == "convex" and found.robot.item() == box.name and found.margin.shape == ()
    alone = rbd.grid(friction=0.5)
    assert len(alone) == 1 and rows(alone) == [{"friction": 0.5}] and alone.fixed == {} and alone.at() == {"friction": 0.5}
    assert dict(alone.dims) == {"sample": 1} and dict((alone * rbd.grid(a=[1, 2])).dims) == {"a": 2}


def test_draws_lie_in_their_ranges_evenly() -> None:
    """Sobol points and Latin hypercubes have one point in each of n slices; means are those of the distributions."""
    ranges = {"a": (0.1, 1.0), "b": stats.norm(20.0, 0.5), "c": stats.loguniform(1.0, 100.0), "k": stats.randint(1, 5)}
    for method in ("sobol", "latin_hypercube"):
        drawn = rbd.sample(256, method=method, seed=3, law=["x", "y"], **ranges).columns(0, 256)
        slices = np.floor((drawn["a"] - 0.1) / 0.9 * 256).astype(int)
        assert sorted(slices) == list(range(256))
        assert abs(drawn["b"].mean() - 20.0) < 0.01 and abs(drawn["b"].std() - 0.5) < 0.02
        assert np.isclose(np.exp(np.log(drawn["c"]).mean()), 10.0, rtol=0.01) and drawn["law"].count("x") == 128
        assert drawn["k"].dtype == np.int64 and np.bincount(drawn["k"]).tolist() == [0, 64, 64, 64, 64]
    plain = rbd.sample(4000, method="random", a=(-1.0, 1.0)).columns(0, 4000)["a"]
    assert abs(plain.mean()) < 0.05 and plain.min() > -1.0 and plain.max() < 1.0


def test_draws_are_those_of_their_seed() -> None:
    """The same seed the same draws, another seed others; more draws begin with those of fewer."""
    for method in ("sobol", "random", "latin_hypercube"):
        draws = [
            rbd.sample(n, method=method, a=(0, 1), b=(5, 6), seed=s).columns(0, 20)["b"] for n, s in ((20, 1), (20, 1), (20, 2))
        ]
        assert (draws[0] == draws[1]).all() and (draws[0] != draws[2]).any()
        more = rbd.sample(40, method=method, a=(0, 1), b=(5, 6), seed=1).columns(0, 20)["b"]
        assert (more == draws[0]).all() or method == "latin_hypercube"
    from scipy.stats import qmc

    known = qmc.Sobol(3, seed=np.random.default_rng(7)).random_base2(5)
    assert (points(32, 3, "sobol", 7) == known).all() and (points(11, 3, "sobol", 7) == known[:11]).all()
    assert rbd.sample(20, a=(0, 1)).digest() != rbd.sample(20, a=(0, 1), seed=1).digest()
    moved = [rbd.sample(20, a=stats.norm(m, 1.0)).digest() for m in (0.0, 1e-6, 0.0)]
    assert moved[0] == moved[2] != moved[1]


def test_no_number_of_draws_warns() -> None:
    """Nor is one that is no power of two an error, where warnings are."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert [len(rbd.sample(n, a=(0, 1))) for n in (1, 2, 3, 100)] == [1, 2, 3, 100]


def test_arguments_may_have_the_names_of_parameters() -> None:
    """n, method, seed and ranges: by a mapping."""
    found = rbd.sample(4, ranges={"seed": (0, 1), "method": ["a", "b"], "n": range(3, 9)}, friction=0.5, seed=2)
    assert found.names == ("seed", "method", "n", "friction") and found.fixed == {"friction": 0.5}
    with pytest.raises(InputError, match="seed is \\(0, 1\\)"):
        rbd.sample(4, seed=(0, 1), a=(0, 1))  # type: ignore[arg-type]


def test_draws_at_every_point_of_a_grid() -> None:
    """The product: every draw for every value; dimensions of both."""
    grid, draws = rbd.grid(friction=[0.3, 0.6], law="convex"), rbd.sample(8, mass=(1.0, 2.0), seed=1)
    both = grid * draws
    assert dict(both.dims) == {"friction": 2, "sample": 8} and both.fixed == {"law": "convex"}
    mass = draws.columns(0, 8)["mass"].tolist()
    assert [(r["friction"], r["mass"]) for r in rows(both)] == [(f, m) for f in (0.3, 0.6) for m in mass]
    assert both.at(friction=0.6, sample=3)["mass"] == mass[3]
    for wrong, told in ((draws, "both samples have mass"), (rbd.sample(3, b=(0, 1)), "both samples vary along 'sample'")):
        with pytest.raises(InputError, match=told):
            both * wrong
    with pytest.raises(InputError, match=r"rbd\.studies\.table"):
        both * {"a": [1]}  # type: ignore[operator]
    with pytest.raises(TypeError):
        np.ones(3) * both  # type: ignore[operator]


COLUMNS = {"friction": [0.3, 0.6, 0.9], "posture": ["low", "high", "low"], "trial": [4, 5, 6]}
RECORDS = [dict(zip(COLUMNS, values, strict=True)) for values in zip(*COLUMNS.values(), strict=True)]
ALONG = xarray.Dataset({name: ("case", values) for name, values in COLUMNS.items()})


def _frame() -> Any:
    return pytest.importorskip("pandas").DataFrame(COLUMNS, index=[7, 8, 9])


@pytest.mark.parametrize(
    "given",
    [
        lambda: COLUMNS,
        lambda: RECORDS,
        lambda: iter(RECORDS),
        lambda: (dict(x) for x in RECORDS),
        lambda: tuple(RECORDS),
        lambda: np.array([tuple(x.values()) for x in RECORDS], [("friction", float), ("posture", "U8"), ("trial", int)]),
        lambda: {name: np.array(values) for name, values in COLUMNS.items()},
        lambda: {name: xarray.DataArray(values, dims="x").values for name, values in COLUMNS.items()},
        lambda: ALONG,
        lambda: ALONG.set_coords(list(COLUMNS)),
        lambda: ALONG.set_coords(list(COLUMNS)).coords,
        lambda: dict(ALONG.data_vars),
        _frame,
    ],
)
def test_tables_of_every_kind_are_the_same_samples(given: Callable[[], object]) -> None:
    """A mapping, rows, an iterator, structured arrays, data frames, datasets."""
    found = samples_of(given())
    assert rows(found) == RECORDS and found.names == tuple(COLUMNS)
    assert set(found.dims.values()) == {3} and set(found.dims) <= {"sample", "case"}


def test_coordinates_of_a_dataset_are_its_samples_again() -> None:
    """Of a grid, of draws, of products; with their units: a study can be asked at the coordinates of another."""
    grid = rbd.grid(friction=[0.3, 0.6], push=[0.0, 50.0], law="convex").with_units(push="N")
    for samples in (grid, rbd.sample(5, a=(0, 1), b=(2, 3)), rbd.grid(c=[1, 2]) * rbd.sample(5, a=(0, 1), b=(2, 3))):
        dataset = xarray.Dataset(coords=samples.coords())
        assert rows(samples_of(dataset.coords)) == rows(samples) and samples_of(dataset).dims == samples.dims
        data = xarray.DataArray(np.zeros(tuple(samples.dims.values())), dataset.coords, tuple(samples.dims))
        assert rows(samples_of(data)) == rows(samples)
    assert samples_of(xarray.Dataset(coords=grid.coords())).coords()["push"][2] == {"units": "N"}


def test_a_column_may_name_the_rows_of_a_table() -> None:
    """A column of the name of the dimension is its coordinate; rows are found by it."""
    cases = rbd.grid(friction=[0.3, 0.6]) * table({"case": ["push", "pull"], "force": [9.0, -9.0]}, dimension="case")
    assert cases.at(case="pull", friction=0.6) == {"friction": 0.6, "case": "pull", "force": -9.0}
    assert cases.coords()["case"][1].tolist() == ["push", "pull"]


def test_units_stand_in_the_attributes_of_coordinates() -> None:
    """They are taken from an array of xarray, too."""
    grid = rbd.grid(push=[0.0, 9.0], a=xarray.DataArray([1, 2], attrs={"units": "m"})).with_units(push="N")
    assert grid.coords()["push"][2] == {"units": "N"} and grid.coords()["a"][2] == {"units": "m"}
    with pytest.raises(InputError, match="nearest: 'push'"):
        grid.with_units(pus="N")
    with pytest.raises(InputError, match="expected text"):
        grid.with_units(push=3)  # type: ignore[arg-type]


def test_nan_is_a_number() -> None:
    """It is a value, once; and can be asked for."""
    grid = rbd.grid(a=[0.5, np.nan])
    assert np.isnan(grid.at(a=np.nan)["a"]) and "nan" in str(grid)
    with pytest.raises(InputError, match="more than once"):
        rbd.grid(a=[np.nan, np.nan])


MASKED = np.ma.masked_array([1, 2], [0, 1])


@pytest.mark.parametrize(
    "ask",
    [
        lambda: rbd.grid(a=MASKED),
        lambda: table({"a": MASKED}),
        lambda: rbd.grid(a={"x": MASKED[0], "y": MASKED[1]}),
        lambda: table(np.ma.masked_array([(1, 2.0), (3, 4.0)], [(0, 0), (1, 0)], [("a", int), ("b", float)])),
        lambda: rbd.grid(a=[MASKED, [3, 4]]),
        lambda: rbd.grid(a=np.ma.masked, b=[1]),
    ],
)
def test_masked_arrays_are_refused(ask: Callable[[], object]) -> None:
    """Never what lies under the mask is taken: in grids, tables, structured arrays, lists of vectors, and as one value."""
    with pytest.raises(InputError, match=r"a is a masked array.*filled\(numpy.nan\)"):
        ask()


def test_missing_values_of_data_frames() -> None:
    """Texts and truth values are None, numbers NaN; None among numbers of a list is meant."""
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"text": ["a", None], "n": pandas.array([1, None], "Int64"), "x": [1.5, None]})
    frame["kind"] = frame.text.astype("category")
    frame["old"] = np.array(["a", np.nan], object)
    frame["yes"] = pandas.array([True, None], "boolean")
    first, second = table(frame)
    assert first == {"text": "a", "n": 1.0, "x": 1.5, "kind": "a", "old": "a", "yes": True}
    assert [second[name] for name in ("text", "kind", "old", "yes")] == [None] * 4
    assert np.isnan(second["n"]) and np.isnan(second["x"])
    assert table(frame).coords()["text"][1].tolist() == ["a", "None"]
    assert [row["limit"] for row in rbd.grid(limit=np.array([0.5, None], object))] == [0.5, None]


def test_samples_are_gone_through_one_by_one() -> None:
    """Each as `row` gives it, over the seams of what is computed at once; as often as wanted."""
    for samples in (
        rbd.grid(a=range(30), b=["x", "y"], c=range(20), d=1.0),
        rbd.grid(a=0.5, law="convex"),
        rbd.sample(3, a=(0, 1)),
    ):
        found = list(samples)
        assert found == [samples.row(i) for i in range(len(samples))] == list(samples)
        assert all(list(row) == list(samples.names) for row in found)
    assert next(iter(rbd.grid(a=range(10**6), b=range(10**6)))) == {"a": 0, "b": 0}


def test_a_grid_takes_a_mapping() -> None:
    """Alone, or beside arguments by name; for names that are computed, or any other."""
    samples = rbd.grid({"x": [1, 2], "arguments": 3}, y=[4])
    assert samples.digest() == rbd.grid(x=[1, 2], arguments=3, y=[4]).digest()
    assert rbd.grid({"x": [1]}).row(0) == {"x": 1}


def _along(dim: str, labels: list[int]) -> xarray.DataArray:
    return xarray.DataArray([1.0, 2.0], {dim: labels}, [dim])


def test_coordinates_of_rows_are_no_arguments() -> None:
    """Unless they are given as such; a plain `sample` and levels of an index are left out."""
    coords = {"t": ("t", [5, 6], {"units": "s"}), "who": ("t", ["a", "b"])}
    given = xarray.Dataset({"a": ("t", [1.0, 2.0])}, coords)
    samples = table(given)
    assert samples.names == ("a",) and dict(samples.dims) == {"t": 2} and samples.row(0) == {"a": 1.0}
    timed = table(dict(given.data_vars, t=given.t))
    assert timed.row(0) == {"a": 1.0, "t": 5} and timed.at(t=6) == {"a": 2.0, "t": 6}
    assert timed.coords()["t"][2] == {"units": "s"}
    levels = xarray.Dataset({"a": (("x", "y"), [[1, 2]])}, {"x": [1], "y": [3, 4]}).stack(sample=["x", "y"])
    assert rows(table(levels)) == [{"a": 1}, {"a": 2}]


WRONG: list[tuple[Callable[[], object], str]] = [
    (lambda: rbd.grid(), "at least one, such as friction"),
    (lambda: rbd.grid(a=[]), "a has no values"),
    (lambda: rbd.grid(a={}), "a has no values"),
    (lambda: rbd.grid(a={1, 2}), "set, which has no order"),
    (lambda: rbd.grid(a=[0.5, 0.6, 0.5]), r"a has 0\.5 more than once.*trial=range\(10\)"),
    (lambda: rbd.grid(a=[[1, 2], [1, 2]]), "more than once"),
    (lambda: rbd.grid(a=["x", "x"]), "a has x more than once"),
    (
        lambda: rbd.grid(a=[Terrain("flat"), Terrain("flat", 1.0)]),
        r"different objects with the same name 'flat'.*'first': \.\.\.",
    ),
    (lambda: rbd.grid(a={"x": 1, 2: 2}), "all texts, or all numbers"),
    (lambda: rbd.grid(a=[[1], [1, 2]]), r"arrays of different shapes, \(1,\), \(2,\)"),
    (lambda: rbd.grid(a=np.ma.masked_array([True, False], [0, 1])), "a is a masked array.*filled"),
    (lambda: table({"a": [1, 2]}, dimension="ok"), "dimension 'ok', which every dataset of a study has"),
    (lambda: table(_along("reason", [1, 2]).rename("a").to_dataset()), "dimension 'reason'"),
    (lambda: rbd.grid({"a": [1]}, a=[2]), "a is given twice, in the mapping and by name"),
    (lambda: rbd.grid([0.3, 0.6]), r"grid has a list; expected arguments by name.*rbd\.grid\(\{'friction'"),  # type: ignore[arg-type]
    (lambda: rbd.grid(ALONG), "grid has a Dataset;.*takes the rows of tables as they are"),
    (lambda: rbd.grid(**{"a/b": [1]}), "without '/'"),
    (lambda: table({"push y": [1]}), "'push y' cannot be the name"),
    (lambda: rbd.grid(push={"x": (1, 0)}, push_value=[1]), "'push_value' twice"),
    (lambda: table({"sample": [1, 1], "a": [1, 2]}), "sample has 1 more than once"),
    (lambda: rbd.grid(a=[1]).row(1), "there is no sample 1; there are 1"),
    (lambda: rbd.grid(a=[1, 2]).columns(1, 3), "not among 0 to 2"),
    (lambda: rbd.grid(a=[0.1, 0.5, 0.9]).at(a=0.52), r"a has no value 0\.52; nearest: '0\.5'"),
    (lambda: rbd.grid(law=["convex", "coulomb"]).at(law="convx"), "nearest: 'convex'"),
    (lambda: rbd.grid(law=["convex", "coulomb"]).at(la="convex"), "no dimension of these samples; nearest: 'law'"),
    (lambda: rbd.grid(law=["convex", "coulomb"]).at(), "law has 2 values; say which"),
    (lambda: rbd.sample(0, a=(0, 1)), "n is 0; expected a whole number from 1"),
    (lambda: rbd.sample(2**31, a=(0, 1)), "n is 2147483648"),
    (lambda: rbd.sample(5, a=(0, 1), method="sobel"), "method is 'sobel'; nearest: 'sobol'"),  # type: ignore[arg-type]
    (lambda: rbd.sample(5, a=(0, 1), seed=-1), "seed is -1"),
    (lambda: rbd.sample(5), r"no range to draw from.*rbd\.grid\(trial=range"),
    (lambda: rbd.sample(5, a=0.5), "no range to draw from"),
    (lambda: rbd.sample(5, a=(1.0, 0.0)), "low below high"),
    (lambda: rbd.sample(5, a=(0.0, np.inf)), "two finite numbers"),
    (lambda: rbd.sample(5, a=(0.0, 1.0, 2.0)), r"expected \(low, high\)"),
    (lambda: rbd.sample(5, a=[0.1, 1.0]), r"write \(0\.1, 1\.0\) for a range, numpy\.array\(\[0\.1, 1\.0\]\) for a choice"),
    (lambda: rbd.sample(5, a=stats.norm(0.0, -1.0)), "quantiles are not finite"),
    (lambda: rbd.sample(5, a=stats.gamma), "freeze it"),
    (lambda: rbd.sample(5, a=stats.multivariate_normal([0, 0])), "rows of a table"),
    (lambda: rbd.sample(5, ranges={"a": (0, 1)}, a=(0, 1)), "a is given twice"),
    (lambda: rbd.sample(5, ranges=[("a", (0, 1))]), "expected a mapping"),  # type: ignore[arg-type]
    (lambda: table({"a": [1, 2], "b": [1, 2, 3], "c": [4, 5]}), "2 values of a, c; 3 values of b"),
    (lambda: table({}), "no columns"),
    (lambda: table([]), "samples are empty"),
    (
        lambda: table([{"a": 1}, {"b": 1}]),
        "sample 1 has no a, and b, which sample 0 does not have; expected the arguments a, as in sample 0",
    ),
    (lambda: table([(0.5, 1.0)]), r"sample 0 is \(0\.5, 1\.0\); expected a mapping of arguments.*'friction': 0\.5"),
    (lambda: table([0.5, 0.6]), "sample 0 is 0.5"),
    (lambda: table(np.zeros((3, 2))), r"array of shape \(3, 2\) without names"),
    (lambda: table("push.csv"), "samples are 'push.csv'; expected"),
    (lambda: table(100), r"rbd\.sample\(100, friction"),
    (lambda: table({"a": {"x": 1}}), "is a mapping"),
    (lambda: table(xarray.DataArray([1.0, 2.0])), "without coordinates"),
    (lambda: rbd.grid(k=[0.0, -0.0]), "k has 0.0 more than once"),
    (lambda: table(xarray.Dataset({"a": ("x", [1]), "b": ("y", [1])})), "several dimensions"),
    (lambda: table(xarray.Dataset({"a": (("x", "y"), [[1]])}, {"x": [1], "y": [1]})), r"dataset\.coords"),
]


@pytest.mark.parametrize(("ask", "told"), WRONG)
def test_what_is_wrong_is_said(ask: Callable[[], object], told: str) -> None:
    """What came, what was expected, what to try."""
    with pytest.raises(InputError, match=f"(?s){told}") as caught:
        ask()
    assert len(str(caught.value)) < 600


def test_samples_say_what_they_are() -> None:
    """In one line, and in a few; of bounded length; in notebooks, too."""
    many = rbd.grid(**{f"argument_{i}": i for i in range(50)})
    assert len(repr(many)) <= 300 and "and 30 more arguments" in str(many)
    grid = rbd.grid(friction=np.linspace(0.1, 1.0, 19), push=[0.0, 200.0], law="convex").with_units(push="N")
    assert repr(grid) == "Samples(38 samples: friction (19) x push (2))"
    assert str(grid).splitlines()[1:] == [
        "  friction  19 values from 0.1 to 1",
        "  push      2 values: 0, 200 N",
        "  law       convex in all",
    ]
    assert "38 samples: friction (19) x push (2)" in grid._repr_html_()
