"""Pictures of studies: which cells, lines and points stand where, what legends count, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import rbd
from rbd.errors.reasons import Reason
from rbd.visual import plot_study

xarray = pytest.importorskip("xarray")
FRICTION, PUSH = np.array([0.1, 0.2, 0.3, 0.5]), np.array([0.0, 10.0, 30.0, 50.0, 60.0])
FRICTION_CODE, OTHER_CODE = Reason.CANNOT_HOLD_FRICTION.code, Reason.OTHER_ERROR.code


def table(dims: dict[str, object], **further) -> xarray.Dataset:
    """A study as `rbd.study` returns it, of a box of 98.1 N: `share` is the friction used, NaN where it slides."""
    given = xarray.Dataset(coords={name: (name, values) for name, values in dims.items()})
    share = given.push / (given.friction * 98.1)
    return labelled(share.transpose(*dims) if len(dims) > 1 else share, given, **further)


def labelled(share: xarray.DataArray, given: xarray.Dataset, **further) -> xarray.Dataset:
    ok = share <= 1.0
    reason = xarray.where(ok, 0, xarray.where(share > 2.0, OTHER_CODE, FRICTION_CODE)).astype("int16")
    flags = {"flag_values": [r.code for r in Reason], "flag_meanings": " ".join(r.name.lower() for r in Reason)}
    table = given.assign(ok=ok, reason=reason.assign_attrs(flags), message=xarray.where(ok, "", "it slides"))
    held = share.where(ok).assign_attrs(units="%", long_name="friction used")
    return table.assign(residual_worst=0.0 * held, share=held, **further)


def grid() -> xarray.Dataset:
    found = table({"friction": FRICTION, "push": PUSH})
    found.push.attrs["units"] = "N"
    row = xarray.DataArray([1.0, 2.0, 3.0], dims="sole_row", coords={"sole_row": ["fx", "fy", "fz"]})
    return found.assign(force_sole=(found.share * row).assign_attrs(units="N"))


def draws(n: int = 40) -> xarray.Dataset:
    rng = np.random.default_rng(0)
    columns = {
        "friction": rng.uniform(0.1, 0.5, n),
        "push": rng.uniform(0.0, 60.0, n),
        "side": rng.choice(["left", "right"], n),
    }
    given = xarray.Dataset(coords={name: ("sample", values) for name, values in columns.items()})
    return labelled(given.push / (given.friction * 98.1), given)


def cell(values: np.ndarray, one: float, other: float) -> int:
    """The value that lies between two edges."""
    return int(np.flatnonzero((values > min(one, other)) & (values < max(one, other)))[0])


def texts(legend) -> list[str]:
    return [text.get_text() for text in legend.get_texts()]


def test_a_map_has_a_cell_for_each_sample_and_the_boundary_midway_between_two():
    """Edges of cells, the value of each, and every piece of the line against the verdicts of its two neighbours."""
    found = grid()
    cells, without, boundary = drawn = plot_study(found)
    assert all(artist.axes is cells.axes for artist in drawn)
    coordinates = cells.get_coordinates()
    assert np.allclose(coordinates[0, :, 0], [0.05, 0.15, 0.25, 0.4, 0.6])
    assert np.allclose(coordinates[:, 0, 1], [-5.0, 5.0, 20.0, 40.0, 55.0, 65.0])
    assert np.array_equal(cells.get_array().filled(np.nan), found.share.values.T, equal_nan=True)
    assert isinstance(without, PolyCollection)
    for i, friction in enumerate(FRICTION):
        for j, push in enumerate(PUSH):
            hatched = any(path.contains_point((friction, push)) for path in without.get_paths())
            assert hatched != bool(found.ok[i, j])
    assert isinstance(boundary, LineCollection)
    ok, seen = found.ok.values, 0
    for (x0, y0), (x1, y1) in boundary.get_segments():
        if x0 == x1:
            i, j = int((FRICTION < x0).sum()), cell(PUSH, y0, y1)
            assert x0 == pytest.approx((FRICTION[i - 1] + FRICTION[i]) / 2.0) and ok[i - 1, j] != ok[i, j]
        else:
            i, j = cell(FRICTION, x0, x1), int((PUSH < y0).sum())
            assert y0 == pytest.approx((PUSH[j - 1] + PUSH[j]) / 2.0) and ok[i, j - 1] != ok[i, j]
        seen += 1
    assert seen == int((ok[1:] != ok[:-1]).sum() + (ok[:, 1:] != ok[:, :-1]).sum())


def test_a_map_says_names_units_and_how_many_are_not_ok():
    """Of a new figure: axes, colour bar, legend."""
    found = grid()
    ax = plot_study(found)[0].axes
    figure = ax.figure
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("friction", "push [N]")
    assert figure.axes[1].get_ylabel() == "friction used [%]"
    assert texts(figure.legends[0]) == [f"not ok ({int((~found.ok).sum())})", "between the last ok and the first not ok"]


def test_the_order_of_samples_does_not_matter():
    """A grid with its values from high to low gives the same picture."""
    found = grid()
    one, other = plot_study(found), plot_study(found.isel(friction=slice(None, None, -1), push=[2, 0, 4, 1, 3]))
    assert np.allclose(one[0].get_coordinates(), other[0].get_coordinates())
    assert np.array_equal(one[0].get_array().filled(9.0), other[0].get_array().filled(9.0))
    assert sorted(map(np.ndarray.tolist, one[2].get_segments())) == sorted(map(np.ndarray.tolist, other[2].get_segments()))


def test_axes_can_be_exchanged_and_values_in_geometric_progression_are_logarithmic():
    """The boundary on a logarithmic axis is at the geometric mean."""
    found = table({"friction": np.geomspace(0.05, 0.8, 5), "push": PUSH})
    ax = plot_study(found, x="push", y="friction")[0].axes
    assert (ax.get_xlabel(), ax.get_yscale(), ax.get_xscale()) == ("push", "log", "linear")
    heights = {y for (_, y), (_, other) in plot_study(found, x="push", y="friction")[-1].get_segments() if y == other}
    means = np.sqrt(found.friction.values[1:] * found.friction.values[:-1])
    assert heights and all(np.abs(means - y).min() < 1e-12 for y in heights)


def test_a_map_of_reasons_counts_each_and_gives_it_a_colour():
    """ok, friction, another error: as many colours, the texts of `Reason`, and how many samples have each."""
    found = grid()
    cells, boundary = plot_study(found, value="reason")
    codes = found.reason.values
    shown = {text: f"{text} ({int((codes == code).sum())})" for code, text in ((FRICTION_CODE, "cannot_hold: friction"),)}
    legend = cells.axes.figure.legends[0]
    assert legend.get_title().get_text() == "reason"
    assert texts(legend) == [
        f"ok ({int((codes == 0).sum())})",
        shown["cannot_hold: friction"],
        f"{Reason.OTHER_ERROR.value} ({int((codes == OTHER_CODE).sum())})",
        "between the last ok and the first not ok",
    ]
    assert len({to_hex(patch.get_facecolor()) for patch in legend.legend_handles[:3]}) == 3
    assert np.array_equal(cells.get_array(), np.searchsorted(np.unique(codes), codes).T) and len(boundary.get_segments()) > 0


def test_a_reason_has_the_same_colour_in_all_pictures():
    """Whatever other reasons there are."""
    found = grid()
    colors = []
    for each in (found, found.isel(friction=slice(1, 4))):
        legend = plot_study(each, value="reason")[0].axes.figure.legends[0]
        colors += [
            to_hex(h.get_facecolor()) for h in legend.legend_handles if h.get_label().startswith("cannot_hold: friction")
        ]
    assert len(colors) == 2 and len(set(colors)) == 1


def test_samples_that_were_not_run_are_neither_ok_nor_not():
    """No boundary along them, and cells of their own."""
    found = grid()
    waiting = found.friction > 0.25
    found["ok"], found["share"] = found.ok & ~waiting, found.share.where(~waiting)
    found["reason"] = xarray.where(waiting, Reason.NOT_RUN.code, found.reason, keep_attrs=True)
    for value in ("share", "reason"):
        *_, boundary = drawn = plot_study(found, value=value, x="friction", y="push")
        assert max(x for segment in boundary.get_segments() for x, _ in segment) <= 0.25 + 1e-12
        assert f"not run ({2 * len(PUSH)})" in texts(drawn[0].axes.figure.legends[0])


def test_one_of_several_values_is_selected_by_its_label():
    """force_sole[fz] is three times the share; without a label the message says what there is."""
    found = grid()
    cells = plot_study(found, value="force_sole[fz]")[0]
    assert np.nanmax(np.abs(cells.get_array().filled(np.nan) - 3.0 * found.share.values.T)) < 1e-15
    assert cells.axes.figure.axes[1].get_ylabel() == "force_sole[fz] [N]"
    with pytest.raises(rbd.InputError, match=r"value='force_sole\[fx\]'.*sole_row: fx, fy, fz"):
        plot_study(found, value="force_sole")
    with pytest.raises(rbd.InputError, match=r"no 'fq' along sole_row; nearest: 'fx', 'fy', 'fz'|no 'fq' along sole_row"):
        plot_study(found, value="force_sole[fq]")


def test_a_third_dimension_is_selected_or_gives_one_map_for_each_value():
    """Named in the error; as small pictures with one scale of colours; also on axes that are given."""
    found = xarray.concat([grid(), grid().assign(share=2.0 * grid().share)], xarray.DataArray(["low", "high"], dims="stance"))
    found = found.assign_coords(stance=["low", "high"])
    with pytest.raises(
        rbd.InputError, match=r"the study also has stance \(2 values\).*dataset\.sel\(stance='low'\).*by='stance'"
    ):
        plot_study(found, x="friction", y="push")
    drawn = plot_study(found, x="friction", y="push", by="stance", value="share")
    maps = [artist for artist in drawn if not isinstance(artist, LineCollection | PolyCollection)]
    assert [m.axes.get_title() for m in maps] == ["low", "high"] and maps[0].norm.vmax == maps[1].norm.vmax
    for names in ({"by": "stance"}, {"x": "friction", "by": "stance"}, {}):  # the others are those left; `by` is the shortest
        again = plot_study(found, value="share", **names)
        assert len(again) == len(drawn) and again[0].axes.get_ylabel() == drawn[0].axes.get_ylabel()
        assert np.ma.allequal(again[0].get_array(), drawn[0].get_array())
    assert len(plot_study(found, by="friction", value="share")[0].axes.figure.axes) == len(FRICTION) + 1
    four = xarray.concat([found, found], xarray.DataArray([0.0, 1.0], dims="wind", name="wind"))
    with pytest.raises(rbd.InputError, match=r"also has push \(5 values\).*dataset\.sel\(push=0\.0\)\.$"):
        plot_study(four, by="stance", x="wind", y="friction")
    left, right = Figure().subplots(1, 2)
    assert {artist.axes for artist in plot_study(found, "friction", "push", "share", "stance", ax=(left, right))} == {
        left,
        right,
    }
    with pytest.raises(rbd.InputError, match="1 axes; expected 2"):
        plot_study(found, "friction", "push", "share", "stance", ax=left)
    assert len(plot_study(found.sel(stance="high"))) == 3


def test_a_large_map_of_many_pieces_is_drawn_plain():
    """Ten thousand samples that are ok or not at random: cells without hatching, which would take seconds."""
    at = np.linspace(0.0, 1.0, 100)
    ok = xarray.DataArray(np.random.default_rng(0).random((100, 100)) < 0.5, dims=("a", "b"), coords={"a": at, "b": at})
    cells, plain, _ = plot_study(xarray.Dataset({"ok": ok, "reason": (~ok * 41).astype("int16"), "v": ok.where(ok)}), value="v")
    assert type(plain) is type(cells) and np.array_equal(~plain.get_array().mask, ~ok.values.T)


def test_curves_end_with_a_ring_and_go_on_as_crosses():
    """Over one dimension, one line for each value of the other: the last that is ok, and those that are not, at the axis."""
    found = grid()
    lines = plot_study(found, x="push")
    curves, marks = lines[: len(FRICTION)], lines[len(FRICTION) :]
    for k, curve in enumerate(curves):
        good = found.ok.values[k]
        assert curve.get_label() == f"{FRICTION[k]:g}"
        assert np.array_equal(curve.get_ydata(), np.where(good, found.share.values[k], np.nan), equal_nan=True)
        own = [m for m in marks if m.get_color() == curve.get_color() and m.get_marker() == "x"]
        assert [list(m.get_xdata()) for m in own] == ([list(PUSH[~good])] if (~good).any() else [])
        rings = [m for m in marks if m.get_marker() == "o" and m.get_markeredgecolor() == curve.get_color()]
        assert [list(m.get_xdata()) for m in rings] == ([[PUSH[good].max()]] if (~good).any() else [])
    ax = curves[0].axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("push [N]", "friction used [%]")
    assert ax.figure.legends[0].get_title().get_text() == "friction"
    assert texts(ax.figure.legends[0])[-2:] == [f"not ok ({int((~found.ok).sum())})", "the last that is ok"]


def test_many_curves_have_a_scale_of_colours_instead_of_names():
    """Twenty frictions: a colour bar."""
    found = table({"friction": np.linspace(0.1, 0.5, 20), "push": PUSH})
    ax = plot_study(found, x="push")[0].axes
    assert len(ax.figure.axes) == 2 and ax.figure.axes[1].get_ylabel() == "friction"
    assert "0.1" not in texts(ax.figure.legends[0])


def test_one_dimension_gives_one_curve_or_one_row_of_reasons():
    """A grid of one name; dimensions of one value are left out."""
    found = table({"friction": [0.2], "push": PUSH})
    assert plot_study(found)[0].get_xdata().tolist() == PUSH.tolist()
    cells, boundary = plot_study(found, value="reason")
    assert cells.get_array().shape == (1, len(PUSH)) and len(boundary.get_segments()) == 1
    assert len(plot_study(found.isel(push=[0]))) > 0


def test_draws_are_points_of_two_coordinates():
    """Coloured by the value where they are ok, crosses where not; by the reason, each with its count."""
    found = draws()
    points, crosses = plot_study(found)
    assert np.array_equal(points.get_offsets(), np.column_stack([found.friction, found.push])[found.ok.values])
    assert np.array_equal(points.get_array(), found.share.values[found.ok.values])
    assert np.array_equal(crosses.get_xdata(), found.friction.values[~found.ok.values])
    by_reason = plot_study(found, value="reason")
    counts = [int((found.reason == code).sum()) for code in np.unique(found.reason)]
    assert [len(a.get_offsets()) for a in by_reason] == counts
    assert texts(by_reason[0].axes.figure.legends[0])[0] == f"ok ({counts[0]})"


def test_draws_over_one_coordinate_show_the_value_upwards():
    """Crosses at the axis where there is none; coloured by a coordinate of numbers or of words."""
    found = draws()
    points, crosses = plot_study(found, x="push", by="friction")
    assert np.array_equal(points.get_offsets()[:, 1], found.share.values[found.ok.values])
    assert np.array_equal(points.get_array(), found.friction.values[found.ok.values])
    assert np.array_equal(crosses.get_xdata(), found.push.values[~found.ok.values])
    words = plot_study(found, x="push", by="side")
    assert {artist.get_label().split(" ")[0] for artist in words[:2]} == {"left", "right"}
    pictures = plot_study(found, x="friction", y="push", by="side")
    assert [ax.get_title() for ax in dict.fromkeys(a.axes for a in pictures)] == ["left", "right"]


def test_draws_at_each_point_of_a_grid_give_a_share():
    """value="ok": the share of those that were run; another quantity wants a draw to be selected."""
    rng = np.random.default_rng(1)
    given = xarray.Dataset(
        coords={"friction": FRICTION, "sample": np.arange(30), "push": ("sample", rng.uniform(0.0, 60.0, 30))}
    )
    found = labelled(given.push / (given.friction * 98.1), given).transpose("friction", "sample")
    found["reason"][0, :10] = found["reason"][3, :] = Reason.NOT_RUN.code
    found["ok"][0, :10] = found["ok"][3, :] = False
    line, *_ = plot_study(found, value="ok")
    expected = 100.0 * np.array([found.ok[0, 10:].mean(), found.ok[1].mean(), found.ok[2].mean(), np.nan])
    assert np.allclose(line.get_ydata(), expected, equal_nan=True) and line.axes.get_ylabel() == "samples that are ok [%]"
    with pytest.raises(rbd.InputError, match=r"sample \(30 values\).*dataset\.sel\(sample=0\)"):
        plot_study(found.expand_dims(side=["left", "right"]), x="friction", by="side", value="share")
    with pytest.raises(rbd.InputError, match=r"sample \(30 values\).*dataset\.sel\(sample=0\)"):
        plot_study(found.expand_dims(side=["left", "right"]), by="side", value="share")


def test_words_and_codes_are_categories():
    """A dimension of words has places of equal width and no boundary along it; codes have the meanings of their flags."""
    found = table({"friction": FRICTION, "push": PUSH}).assign_coords(friction=["ice", "steel", "wood", "rubber"])
    found = found.assign(status=found.ok.astype("int8").assign_attrs(flag_values=[0, 1], flag_meanings="failed solved"))
    cells, *_, boundary = plot_study(found)
    assert [t.get_text() for t in cells.axes.get_xticklabels()] == ["ice", "steel", "wood", "rubber"]
    assert all(y0 == y1 for (_, y0), (_, y1) in boundary.get_segments())
    legend = plot_study(found, value="status")[0].axes.figure.legends[0]
    assert [text.split(" ")[0] for text in texts(legend)[:2]] == ["failed", "solved"]


def test_words_and_truth_values_are_missing_where_a_sample_is_not_ok():
    """Empty text and False stand for nothing there: such cells are grey, as those of numbers."""
    found = grid()
    bad = f"not ok ({int((~found.ok).sum())})"
    pushed = found.push > 5.0
    found = found.assign(motor=xarray.where(found.ok, xarray.where(pushed, "knee", "hip"), ""), least=found.ok & pushed)
    for value, words in (("motor", ["hip", "knee"]), ("least", ["no", "yes"])):
        cells, without, _ = plot_study(found, value=value)
        legend = texts(cells.axes.figure.legends[0])
        assert [text.split(" ")[0] for text in legend[:2]] == words and legend[2] == bad
        assert np.array_equal(cells.get_array().mask, ~found.ok.values.T) and isinstance(without, PolyCollection)
    assert texts(plot_study(found, value="ok")[0].axes.figure.legends[0])[0] == bad.replace("not ok", "no")


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"x": "fricton"}, "nearest: 'friction'"),
        ({"value": "shar"}, "nearest: 'share'"),
        ({"value": "message"}, "reason"),
        ({"value": "share[fx]"}, "leave out"),
        ({"x": "push", "y": "push"}, "different dimensions"),
        ({"y": "push"}, "x alone"),
        ({"ax": 3}, "Matplotlib axes"),
        ({"dataset": {}}, "rbd.study"),
        ({"dataset": xarray.Dataset()}, "rbd.study"),
        ({"by": "ok"}, "nearest|there are"),
    ],
)
def test_what_cannot_be_drawn_is_named(given, named):
    """Names with the nearest ones, axes, other datasets."""
    with pytest.raises(rbd.InputError, match=named):
        plot_study(**{"dataset": grid(), **given})


def test_nothing_to_draw_and_too_much_are_refused():
    """No samples; more than a picture shows; more maps than there is room for."""
    with pytest.raises(rbd.InputError, match="no samples"):
        plot_study(grid().isel(friction=slice(0, 0)))
    big = xarray.Dataset({"ok": ("sample", np.ones(4_000_001, bool)), "reason": ("sample", np.zeros(4_000_001, "int16"))})
    with pytest.raises(rbd.InputError, match="4000001 samples"):
        plot_study(big)
    many = xarray.concat([grid()] * 13, xarray.DataArray(np.arange(13.0), dims="run", name="run"))
    with pytest.raises(rbd.InputError, match="by='run' has 13 values"):
        plot_study(many, x="friction", y="push", by="run")


def test_a_number_that_is_the_same_everywhere_or_nowhere():
    """One colour, at the middle of its scale; a scale without numbers."""
    found = grid().assign(share=0.0 * grid().share.fillna(0.0) + 3.0)
    cells = plot_study(found, value="share")[0]
    assert (cells.norm.vmin, cells.norm.vmax) == pytest.approx((2.7, 3.3))
    cells = plot_study(found.assign(share=found.share * np.nan), value="share")[0]
    bar = cells.axes.figure.axes[1]
    assert bar.get_ylabel() == "friction used [%]" and not len(bar.get_yticks())


def test_a_study_without_any_answer_still_shows_why():
    """No numbers at all: the default is the map of reasons."""
    found = grid()[["ok", "reason", "message"]]
    found["ok"], found["reason"] = found.ok & False, xarray.full_like(found.reason, FRICTION_CODE)
    (cells,) = plot_study(found)
    assert texts(cells.axes.figure.legends[0]) == [f"cannot_hold: friction ({found.ok.size})"]


def slide(friction: float, push: float) -> dict[str, object]:
    """The friction used by a box of 98.1 N, and the force that its floor gives."""
    if push > friction * 98.1:
        raise rbd.CannotHold("it slides")
    return {"used": push / (friction * 98.1), "force": np.array([-push, 0.0, 98.1])}


def test_a_study_of_a_function_is_drawn_as_it_is_returned_and_as_it_is_stored(tmp_path):
    """From memory and from a store, opened lazily: the same cells; text and grids as `rbd.study` makes them."""
    samples = rbd.grid(friction=FRICTION, push=PUSH).with_units(push="N")
    store = tmp_path / "slide.zarr"
    found = rbd.study(slide, samples, executor=0, out=store, progress=False)
    stored = xarray.open_zarr(store)
    for value in ("used", "reason", "force[2]"):
        one, other = (plot_study(each, value=value)[0] for each in (found, stored))
        assert np.array_equal(one.get_array().filled(-9.0), other.get_array().filled(-9.0)), value
        assert one.axes.get_ylabel() == other.axes.get_ylabel() == "push [N]"
    assert plot_study(found)[0].axes.figure.axes[1].get_ylabel() == "used"
    legend = plot_study(found, value="reason")[0].axes.figure.legends[0]
    assert texts(legend)[:2] == ["ok (8)", "cannot_hold (12)"]
