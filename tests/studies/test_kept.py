"""What a study keeps of a result: names, units, labels, certificates, rows without an answer, and what cannot be kept."""

from __future__ import annotations

import inspect
import math
import re
from collections import namedtuple
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import rbd
from rbd.answers.many import StateStatus
from rbd.errors import Reason
from rbd.records import Variable, documented, fields_of, unit_and_meaning
from rbd.statics.planar_projection import inscribed_radius
from rbd.studies.results import Block, Keep, KeptRows, Layout, NotKept, OutputSelection, is_of_many, text_of

TABLES = (
    rbd.Solution, rbd.Actuation, rbd.control.TaskActuation, rbd.answers.many.Solutions, rbd.statics.Actuations, rbd.State,
    rbd.mechanism.FoundPose, rbd.Trajectory, rbd.motion.MotionReport, rbd.statics.PushLimits, rbd.statics.SupportRegion,
    rbd.statics.ZmpRegion, rbd.answers.analysis.Uniqueness, rbd.studies.LawComparison, rbd.mechanism.Mobility,
)  # fmt: skip
"""Types with a column in the tables of docs/reference/studies.md."""
CENTRE = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


class Found:
    """A block, with what is kept of results apart from the three variables that every study has."""

    def __init__(self, block: Block) -> None:
        self.numbers, own = block.numbers, {name: block.variables[name].values for name in ("ok", "reason", "message")}
        self.ok, self.reason = own["ok"], own["reason"]
        self.messages = {int(i): text for i, text in zip(block.numbers, own["message"], strict=True) if text}
        self.variables = {name: variable for name, variable in block.variables.items() if name not in own}


def kept(*results: Any, keep: Keep = None, **options: Any) -> Found:
    """The block of some results."""
    rows = KeptRows(len(results), OutputSelection(keep), **options)
    for i, result in enumerate(results):
        if (error := rows.put(i, result)) is not None:
            rows.refuse(i, error)
    return Found(rows.block())


def batch(result: Any, n: int, keep: Keep = None) -> Found:
    """The block of one batch."""
    rows = KeptRows(n, OutputSelection(keep), first=1000)
    assert rows.put(0, result, n) is None
    return Found(rows.block())


def values(block: Found) -> dict[str, list[Any]]:
    """{name: values of all samples}."""
    return {name: variable.values.tolist() for name, variable in block.variables.items()}


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    """Solo, 12 motors; do not change it."""
    return rbd.load_robot("solo12")


@pytest.fixture(scope="module")
def held(solo: rbd.Robot) -> rbd.Actuation:
    """Solo standing on four feet."""
    return rbd.hold(solo.standing(), solo.feet(friction=0.7))


@pytest.fixture(scope="module")
def solution(solo: rbd.Robot, held: rbd.Actuation) -> rbd.Solution:
    """The answer under these torques."""
    return rbd.solve(solo.standing(), held.tau, solo.feet(friction=0.7))


class TestPlainValues:
    """Numbers, truth values, text and arrays."""

    def test_a_number_is_called_value(self):
        """Whole numbers are kept as float64 too, so that NaN can stand where there is none."""
        block = kept(0.5, 2, np.float32(0.25))
        assert values(block) == {"value": [0.5, 2.0, 0.25]} and block.variables["value"].values.dtype == float
        assert block.ok.all() and not block.reason.any() and not block.messages

    def test_an_array_has_dimensions_of_its_name(self):
        """value_0, value_1 of what has no name."""
        assert kept(np.zeros((2, 3))).variables["value"].dims == ("value_0", "value_1")
        assert kept({"slip": [1, 2]}).variables["slip"].dims == ("slip_0",)

    def test_values_by_name(self):
        """Each kind has what stands where there is none: NaN, False, no text."""
        block = kept({"x": 1, "moves": True, "why": "it slips"}, {"x": None}, {"why": "it tips over an edge"})
        assert values(block)["moves"] == [True, False, False]
        assert values(block)["why"] == ["it slips", "", "it tips over an edge"]
        np.testing.assert_array_equal(block.variables["x"].values, [1.0, np.nan, np.nan])

    def test_dataclasses_and_named_tuples_are_values_by_name(self):
        """Fields are names."""

        @dataclass
        class Found:
            height: float
            feet: dict[str, float]

        pair = namedtuple("pair", "a b")
        assert values(kept(Found(1.0, {"left": 2.0}))) == {"height": [1.0], "feet_left": [2.0]}
        assert values(kept(pair(1, 2))) == {"a": [1.0], "b": [2.0]}

    def test_codes_have_flags(self):
        """An IntEnum is a code, with its meanings."""
        block = kept({"mode": StateStatus.INFEASIBLE})
        assert block.variables["mode"].attributes["flag_meanings"].split()[3] == "infeasible"
        assert values(block) == {"mode": [3]} and block.variables["mode"].values.dtype.kind == "i"

    def test_labelled_arrays_keep_their_labels(self):
        """Dimensions, coordinates and units of xarray."""
        xarray = pytest.importorskip("xarray")
        array = xarray.DataArray([1.0, 2.0], {"foot": ["left", "right"]}, ["foot"], attrs={"units": "N", "long_name": "load"})
        for result in ({"load": array}, xarray.Dataset({"load": array})):
            found = kept(result).variables["load"]
            assert found.dims == ("foot",) and found.labels == {"foot": ("left", "right")}
            assert (found.units, found.long_name, found.values.tolist()) == ("N", "load", [[1.0, 2.0]])

    @pytest.mark.parametrize(
        ("result", "message"),
        [
            (None, "sample 0: the function returned None; expected numbers"),
            ((1.0, 2.0), "returned a tuple of 2; return them by name, e.g. {'friction_used'"),
            (object(), "returned an object, <object"),
            (1j, "returned a complex"),
            (np.array([1j]), "returned an array of complex128.*real and imaginary part by name"),
            ({"x": {"y": {"z": 1}}}, "'x_y' is a dict"),
            ({"x": np.array([object()])}, "'x' is an array of object"),
            ({"x": [[1], [1, 2]]}, "'x' is a list"),
            ({"x": []}, r"'x' has shape \(0,\), without entries"),
            ({"x": 2**60}, "'x' has a whole number beyond 2.53"),
            ({"x": 10**400}, "'x' is"),
            ({"max torque": 1.0}, "has the name 'max torque'; expected letters, digits and _, e.g. 'max_torque'"),
            ({1: 1.0}, "has the name '1'; expected letters"),
            ({"ok": True}, "has the name 'ok', which every study has itself"),
            ({"friction": 0.5}, "has the name 'friction', which is an argument"),
            ({"a b": 1.0, "a-b": 2.0}, "has the name"),
        ],
    )
    def test_what_cannot_be_kept(self, result: Any, message: str):
        """An error that says what came, what is expected, and in which sample."""
        with pytest.raises(rbd.InputError, match=message):
            kept(result, arguments=["friction"])


@pytest.mark.parametrize("given", [np.ma.array([1, 2], mask=[0, 1]), [1.0, np.ma.masked], np.ma.array([True, False])])
def test_masked_arrays_are_refused(given: Any):
    """Their masked entries would be numbers like others."""
    with pytest.raises(rbd.InputError, match=r"'value' is a masked array; return x\.filled\(numpy\.nan\)"):
        kept(given)


class TestAgreement:
    """Samples have the same shapes, kinds and labels under one name."""

    @pytest.mark.parametrize(
        ("first", "second", "message"),
        [
            (
                np.zeros(2),
                np.zeros(3),
                r"'value' has the shape \(3,\) in sample 8, and \(2,\) in sample 7. Return arrays of one shape",
            ),
            ({"x": 1.0}, {"x": True}, "'x' has the kind 'truth values' in sample 8, and 'numbers' in sample 7"),
            ({"x": "a"}, {"x": 1.0}, "'x' has the kind 'numbers' in sample 8, and 'text' in sample 7"),
            (
                xr.DataArray([1.0], dims="leg", attrs={"units": "m"}),
                xr.DataArray([1.0], dims="leg", attrs={"units": "mm"}),
                "'value' has the unit 'mm' in sample 8, and 'm' in sample 7. Return it in one unit always",
            ),
            (1.0, np.zeros(0), r"sample 8: 'value' has shape \(0,\), without entries; leave it out, or return None"),
        ],
    )
    def test_of_two_samples(self, first: Any, second: Any, message: str):
        """The error names the variable and both samples."""
        with pytest.raises(rbd.InputError, match=message):
            kept(first, second, first=7)

    def test_of_labels(self):
        """The first label that differs is named."""
        xarray = pytest.importorskip("xarray")
        a, b = (xarray.DataArray([1.0, 2.0], {"foot": ["left", x]}, ["foot"]) for x in ("right", "hind"))
        with pytest.raises(
            rbd.InputError, match="dimension 'foot' of 'load' has the labels 'hind' in sample 1, and 'right' in sample 0"
        ):
            kept({"load": a}, {"load": b})
        with pytest.raises(rbd.InputError, match="dimension 'foot' of 'more' has the labels"):
            kept({"load": a, "more": b})
        with pytest.raises(rbd.InputError, match="dimension 'foot' of 'more' has the length 1 in sample 0, and 2 in sample 0"):
            kept({"load": a, "more": a[:1]})
        plain = xarray.DataArray([1.0, 2.0], dims=["foot"])
        assert set(kept({"plain": plain, "load": a}).variables) >= {"plain", "load"}  # one of them says the labels

    def test_of_blocks(self):
        """Blocks of one study agree as samples do, whatever the length of their text."""
        layout = Layout()
        layout.add(kept({"x": 1.0, "why": "short"}))
        layout.add(kept({"x": 2.0, "why": "longer text", "y": 1.0}, first=1))
        with pytest.raises(rbd.InputError, match=r"'x' has the shape \(2,\) in sample 2, and \(\) in sample 0"):
            layout.add(kept({"x": np.zeros(2)}, first=2))

    def test_a_dimension_is_no_argument(self, solution: rbd.Solution):
        """A grid over `motor` cannot stand beside the dimension of that name."""
        with pytest.raises(
            rbd.InputError, match="the dimension 'velocity' of 'a' in sample 0 has the name 'velocity', which is an argument"
        ):
            kept(solution, arguments=["velocity"])

    def test_samples_may_have_different_values(self, solo: rbd.Robot, held: rbd.Actuation):
        """The union of all names; NaN where a sample has none of it."""
        two = rbd.hold(solo.standing(), solo.feet(friction=0.7)[:3])
        block = kept(held, two)
        loads = block.variables["force_hind_right"].values
        assert np.isfinite(loads[0]).all() and np.isnan(loads[1]).all() and block.ok.all()

    def test_robots_of_two_sizes(self, solution: rbd.Solution):
        """Torques of two robots do not fit into one variable; what fits may be kept."""
        box = rbd.testing.box()
        fall = rbd.solve(rbd.State(box, CENTRE), [])
        with pytest.raises(
            rbd.InputError, match=r"'a' has the shape \(6,\) in sample 1, and \(18,\) in sample 0.*studies of their own"
        ):
            kept(solution, fall)
        assert values(kept(solution, fall, keep=("status",)))["status"] == [0, 0]

    def test_two_contacts_of_one_key(self, solo: rbd.Robot):
        """Names that differ in blanks only would be one variable."""
        a, b = solo.feet(friction=0.7)[:2]
        feet = [rbd.PointContact("a b", a.frame, friction=0.7), rbd.PointContact("a_b", b.frame, friction=0.7)]
        with pytest.raises(rbd.InputError, match="two values would have the name 'force_a_b'.*Give contacts names that differ"):
            kept(rbd.solve(solo.standing(), np.zeros(solo.nu), feet))


class TestKeep:
    """The argument `keep`."""

    def test_names(self, held: rbd.Actuation):
        """Names, and the certificate always."""
        assert list(values(kept(held, keep=["least"]))) == ["status", "worst_residual", "least"]
        assert list(values(kept({"a": 1, "b": 2}, keep=("b",)))) == ["b"]

    def test_functions(self, held: rbd.Actuation):
        """A function of the result by name; names beside it."""
        least = {"least_margin": lambda held: held.margins.torque.min()}
        assert list(values(kept(held, keep=least))) == ["status", "worst_residual", "least_margin"]
        found = kept(held, keep=("worst_torque", least))
        assert list(found.variables) == ["status", "worst_residual", "worst_torque", "least_margin"]
        assert values(found)["least_margin"][0] == pytest.approx(1.0 - values(found)["worst_torque"][0])

    def test_a_function_that_raises_is_a_row(self):
        """As the study's function would be."""
        block = kept({"x": 1.0}, {"x": 0.0}, keep={"inverse": lambda found: 1 / found["x"]})
        assert block.ok.tolist() == [True, False] and block.reason[1] == Reason.OTHER_ERROR.code
        assert block.messages == {1: "ZeroDivisionError: float division by zero"} and math.isnan(values(block)["inverse"][1])

    @pytest.mark.parametrize(
        ("keep", "message"),
        [
            ("forces", r"keep is 'forces'; expected names, e.g. keep=\('forces',\)"),
            (3, "keep is 3; expected names"),
            ((3,), "keep has the entry 3"),
            (("a", "a"), "keep names 'a' twice"),
            ({"a": 1}, r"keep\['a'\] is 1; expected a function of a result"),
            ({"ok": len}, "keep has the name 'ok'"),
            ({"a b": len}, "keep has the name 'a b'"),
        ],
    )
    def test_nonsense(self, keep: Any, message: str):
        """Known before work starts."""
        with pytest.raises(rbd.InputError, match=message):
            OutputSelection(keep)

    def test_unknown_names(self, held: rbd.Actuation):
        """At the first result, with the nearest names."""
        with pytest.raises(rbd.InputError, match="sample 0: keep names 'forcs', which Actuation has not; nearest: 'forces'"):
            kept(held, keep=("forcs",))
        with pytest.raises(rbd.InputError, match="keep names 'heigth', which the function did not return; nearest: 'height'"):
            kept({"height": 1.0}, keep=("heigth",))


class TestRecords:
    """Records of this package."""

    def test_a_solution(self, solution: rbd.Solution, solo: rbd.Robot):
        """Its accelerations and forces with labels and units, and its certificate."""
        block = kept(solution)
        assert list(block.variables)[:3] == ["status", "worst_residual", "a"]
        a, force = block.variables["a"], block.variables["force_front_left"]
        np.testing.assert_array_equal(a.values[0], solution.a)
        assert a.dims == ("velocity",) and a.labels["velocity"][6] == "FL_HAA" and a.units == "m/s2 or rad/s2"
        np.testing.assert_array_equal(force.values[0], solution.forces["front_left"])
        assert (force.dims, force.labels, force.units) == (
            ("front_left_row",), {"front_left_row": ("fx", "fy", "fz")}, "N",
        )  # fmt: skip
        assert values(block)["worst_residual"] == [solution.residuals.worst] and values(block)["status"] == [0]

    def test_an_actuation(self, held: rbd.Actuation):
        """Torques by motor and their shares of the limits."""
        block = kept(held, keep=("tau", "worst_torque", "worst_motor", "used_torque", "margins"))
        tau = block.variables["tau"]
        assert tau.units == "N m" and tau.labels["motor"] == tuple(held.state.robot.actuated_names)
        used = block.variables["used_torque"].values[0]
        assert values(block)["worst_torque"] == [used.max()]
        assert values(block)["worst_motor"] == [held.state.robot.actuated_names[int(used.argmax())]]
        assert values(block)["margin_friction_front_left"] == [held.margins.friction["front_left"]]

    def test_a_failed_answer_is_a_row_that_is_not_ok(self):
        """As a row of solve_many: its certificate stays, its numbers do not."""
        rows = [
            rbd.Rows(x, J=np.ones((1, 2)), bias=np.array([y]), cone=rbd.problem.Free(1)) for x, y in (("a", 0.0), ("b", 1.0))
        ]
        failed = rbd.solve_problem(rbd.GaussProblem(M=np.eye(2), rhs=np.zeros(2), rows=rows), check=False)
        block = kept(failed)
        assert not block.ok[0] and block.reason[0] == Reason.CONTRADICTION.code and block.messages[0]
        assert list(block.variables) == ["status", "worst_residual"] and values(block)["status"] == [
            int(StateStatus.INFEASIBLE)
        ]

    def test_a_limit_that_is_not_reached_has_a_force_of_zero(self):
        """So that it is one variable with that of samples in which it is reached."""
        pendulum = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        stop = rbd.JointLimit("stop", "joint_1", lower=0.0)
        found = [rbd.solve(pendulum.at([q]), [0.0], [stop]) for q in (0.0, 0.5)]
        np.testing.assert_allclose(kept(*found).variables["force_stop"].values, [[4.905], [0.0]])

    def test_a_simulation(self):
        """Its end and its extremes."""
        box = rbd.testing.box(mass=10.0)
        fall = rbd.simulate(rbd.State(box, [0, 0, 1, 0, 0, 0, 1]), duration=0.2, step=0.1)
        found = values(kept(fall))
        assert found["duration"] == [0.2] and found["ended_early"] == [False]
        np.testing.assert_allclose(found["final_com"][0], fall.com[-1])
        assert found["lowest_com"] == [fall.com[:, 2].min()] and abs(found["energy_change"][0]) < 1e-9
        assert found["end_reason"] == [0] and values(kept(fall, keep=("interrupted",)))["interrupted"] == [""]

    def test_a_checked_motion(self, solo: rbd.Robot):
        """Shares of frames, by cause."""
        low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
        report = rbd.check_motion(rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=50.0))
        found = values(kept(report))
        assert found["share_possible"] == [report.share_possible] and found["score"] == [report.score]
        assert found["share_floats"] == [report.of_cause("floats").mean()] and found["share_joint_limit"] == [0.0]

    def test_limits_of_standing(self, solo: rbd.Robot):
        """Pushes, support regions and zero-moment regions."""
        state, feet = solo.standing(), solo.feet(friction=0.7)
        limits = rbd.statics.push_limits(state, feet, "base_link", [(1, 0, 0), (0, 0, -1)], at_most=200.0)
        block = kept(limits, keep=("push_limit", "push_direction", "gives_way"))
        np.testing.assert_array_equal(block.variables["push_limit"].values[0], limits.forces)
        assert block.variables["gives_way"].values.shape == (1, 2) and values(block)["gives_way"][0][0]
        region = rbd.statics.support_region(state, feet)
        found = values(kept(region, keep=("area", "com_distance", "inscribed_radius")))
        assert found["area"] == [region.area] and found["com_distance"] == pytest.approx(found["inscribed_radius"])
        zmp = rbd.statics.zmp_region(state, feet, friction="inscribed")
        assert 0.05 < values(kept(zmp, keep=("area", "inscribed_radius")))["inscribed_radius"][0] < 0.2

    def test_poses_and_uniqueness(self, solo: rbd.Robot, solution: rbd.Solution):
        """Configurations with labels; dimensions of what is open."""
        state = solo.standing()
        assert kept(state).variables["q"].labels["position"][7] == "FL_HAA"
        found = rbd.find_pose(solo, {"FL_FOOT": (0.2, 0.2, 0.05)})
        assert values(kept(found))["worst_error"] == [found.worst]
        unique = solution.uniqueness()
        open_ = values(kept(unique))
        assert open_["row_freedom"] == [unique.row_freedom]
        assert open_["normal_lowest_front_left"] == [unique.contacts["front_left"].normal.lowest]

    def test_a_control_step(self, solo: rbd.Robot):
        """An actuation with the certificate of the step, and what tasks missed."""
        state = solo.standing()
        up = rbd.control.ComTask(state.com + [0.0, 0.0, 0.01], gain=100.0)
        step = rbd.control.step(state, [up], solo.feet(friction=0.7))
        found = values(kept(step, keep=("missed", "violation")))
        assert found["missed_com"] == [np.abs(step.missed["com"]).max()] and found["violation"] == [0.0]
        assert found["worst_certificate"] == [step.certificate.worst] and found["status"] == [0]

    def test_comparisons_of_laws(self):
        """The difference of both laws, with the larger of both residuals."""
        face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)
        push = [rbd.ExternalForce("box", (80.0, 0.0, 0.0))]
        both = rbd.studies.compare_laws(rbd.State(rbd.testing.box(mass=10.0), CENTRE), [], [face], external=push)
        block = kept(both, keep=("difference", "normal_ratio", "lift_off"))
        found = values(block)
        assert block.ok.all() and found["worst_residual"] == [max(both.convex.residuals.worst, both.coulomb.residuals.worst)]
        assert found["difference"] == [both.difference] and found["normal_ratio_face"] == [both.normal_ratio["face"]]
        assert 0.5 < found["lift_off_face"][0] < 1.5

    def test_mobility_of_mechanisms(self):
        """Counted, instantaneous and finite degrees of freedom."""
        found = rbd.mechanism.mobility(rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0).at("assembled"))
        freedom = {name: x[0] for name, x in values(kept(found)).items()}
        assert (freedom["counted"], freedom["instantaneous"], freedom["finite"], freedom["singular"]) == (1.0, 1.0, 1.0, False)

    def test_records_by_name(self, held: rbd.Actuation):
        """Several records in one result: the name stands in front."""
        found = kept({"before": held, "mass": 2.5})
        assert {"before_status", "before_worst_residual", "before_force_front_left", "mass"} <= set(found.variables)

    def test_every_type_has_its_names(self):
        """Each type has certificates among its names, and lines that say what they are."""
        for kind in TABLES:
            assert any(line.default for line in fields_of(kind)), kind
            for line in fields_of(kind):
                assert line.name.isidentifier() and len(line.meaning) > 5, f"{kind}: {line.name}"
                assert line.default or not line.certificate

    @pytest.mark.parametrize("kind", TABLES, ids=lambda kind: kind.__name__)
    def test_tables_agree_with_docstrings(self, kind: type):
        """A field that is an attribute is documented, as an attribute or a property, with the same unit."""
        told = documented(kind)
        for line in fields_of(kind):
            if line.value is not None:
                continue
            text = inspect.getdoc(getattr(kind, line.name, None)) if line.name not in told else ""
            assert line.name in told or text, f"{line.name} is not documented"
            unit = told[line.name][0] if line.name in told else unit_and_meaning((text or "").split("\n\n")[0])[0]
            shown = line.unit.replace("{}/s2", "m/s2, rad/s2").replace("{}/s", "m/s, rad/s").replace("{}", "N, N m")
            if unit or shown not in ("", "1", "N, N m"):  # shares and truth values have no brackets
                assert unit.split(";")[0] == shown, f"{line.name}: {unit!r} in the docstring, {shown!r} in the table"

    def test_every_name_of_every_type_gives_something(self, solo: rbd.Robot, held: rbd.Actuation, solution: rbd.Solution):
        """Each type that a study knows, with all that it may keep: each has a unit or a meaning, and one row a sample."""
        state, feet = solo.standing(), solo.feet(friction=0.7)
        box = rbd.testing.box(mass=10.0)
        face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)
        resting = rbd.State(box, CENTRE)
        motion = rbd.motion.minimum_jerk(solo, [state.q, state.q], [0.0, 0.1], rate=50.0)
        records = [
            *(solution, held, state, solution.uniqueness(), rbd.check_motion(motion)),
            rbd.control.step(state, [rbd.control.PostureTask(state.q)], feet),
            rbd.solve_many(solo, state.q, None, held.tau, feet),
            rbd.statics.hold_many(solo, state.q, feet),
            rbd.find_pose(solo, {"FL_FOOT": (0.2, 0.2, 0.05)}),
            rbd.simulate(resting, duration=0.02, step=0.01, constraints=[face]),
            rbd.statics.push_limits(state, feet, "base_link", [(1, 0, 0)]),
            rbd.statics.support_region(state, feet, friction="inscribed"),
            rbd.statics.zmp_region(state, feet, friction="inscribed"),
            rbd.studies.compare_laws(resting, [], [face]),
            rbd.mechanism.mobility(rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0).at("assembled")),
        ]
        assert {type(record) for record in records} == set(TABLES), "a type without a record above"
        for record in records:
            names = tuple(line.name for line in fields_of(type(record)))
            block = batch(record, 1, names) if is_of_many(record) else kept(record, keep=names)
            assert block.ok.all(), block.messages
            assert len(block.variables) >= len(names) - 1  # a foot that is a point has no margin of pressure
            assert all(variable.values.shape[:1] == (1,) and variable.long_name for variable in block.variables.values())

    def test_the_reference_lists_every_name(self):
        """docs/reference/studies.md has each name with its line, and a mark where a type has it: always, kept, if named."""
        page = (Path(__file__).parents[2] / "docs" / "reference" / "studies.md").read_text(encoding="utf-8")
        listed: dict[str, set[tuple[str, str, str]]] = {}
        for row in page.partition("<!-- names -->")[2].splitlines():
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]]
            if cells and re.fullmatch(r"`[\w.]+`", cells[-1]):
                types = [cell.strip("`").rpartition(".")[2] for cell in cells[2:]]
            elif cells and cells[0].startswith("`"):
                for kind, mark in zip(types, cells[2:], strict=True):
                    if mark:
                        listed.setdefault(kind, set()).add((cells[0].strip("`"), re.sub(r"[`\\]", "", cells[1]), mark))
        expected = {}
        for kind in TABLES:
            expected[kind.__name__] = {
                (line.name, line.meaning, "●" if line.certificate else "✓" if line.default else "○") for line in fields_of(kind)
            }
        assert listed == expected

    def test_kept_names(self):
        """What keep may name, by type; of a subclass those of its base."""
        assert rbd.studies.kept_names(rbd.Solution)["forces"].startswith("force or wrench")
        assert rbd.studies.kept_names(rbd.answers.many.Solutions)["forces"].startswith("force or wrench")
        for nonsense in (int, 3, "Solution"):
            with pytest.raises(rbd.InputError, match="is no type of which a study keeps something by name"):
                rbd.studies.kept_names(nonsense)  # type: ignore[arg-type]


class TestBatches:
    """Results of batched functions: one row a sample."""

    def test_solutions_are_as_their_rows(self, solo: rbd.Robot, held: rbd.Actuation):
        """The same names, dimensions, labels and units as of one state, and the same numbers."""
        mu = np.array([0.4, 0.7, 0.9])
        many = rbd.solve_many(solo, solo.standing().q, None, held.tau, solo.feet(), friction=mu)
        keep = ("status", "forces", "worst_residual", "friction_used", "centre_of_pressure", "residuals", "a", "corner_forces")
        block, rows = batch(many, 3, keep), kept(*many, keep=keep)
        assert set(rows.variables) - set(block.variables) == {"residual_centroidal"}  # of whole answers only
        assert set(block.variables) < set(rows.variables) and block.ok.all()
        for name, found in block.variables.items():
            one = rows.variables[name]
            assert (found.dims, found.units, found.labels, found.long_name) == (one.dims, one.units, one.labels, one.long_name)
            np.testing.assert_allclose(found.values, one.values, rtol=1e-6, atol=1e-9, err_msg=name)

    def test_names_are_those_of_the_dataset(self, solo: rbd.Robot, held: rbd.Actuation):
        """`to_xarray` of many answers and a study have one list of names."""
        pytest.importorskip("xarray")
        many = rbd.solve_many(solo, solo.standing().q, None, held.tau, solo.feet())
        data, block = many.to_xarray(), batch(many, 1, keep=("forces", "friction_used", "a", "residuals"))
        for name, variable in block.variables.items():
            if name != "worst_residual":
                assert data[name].dims[1:] == variable.dims and data[name].attrs == variable.attributes

    def test_rows_without_an_answer(self, solo: rbd.Robot):
        """Their reason and message; NaN in their numbers."""
        held = rbd.statics.hold_many(solo, solo.standing().q, solo.feet(), coefficients=[0.7, 0.0, -1.0])
        block = batch(held, 3)
        assert block.ok.tolist() == [True, True, False] and block.reason[2] == Reason.BAD_INPUT.code
        assert list(block.messages) == [1002] and block.messages[1002].startswith("friction of 'front_left' is -1.0; expected")
        assert np.isnan(block.variables["tau"].values[2]).all()
        assert block.variables["status"].values.tolist() == held.status.tolist()

    def test_arrays(self):
        """Each with one row a sample; by name or not."""
        assert values(batch(np.arange(3), 3)) == {"value": [0.0, 1.0, 2.0]}
        block = batch({"x": np.zeros((3, 2)), "why": np.array(["a", "bc", ""])}, 3)
        assert block.variables["x"].dims == ("x_0",) and values(block)["why"] == ["a", "bc", ""]
        assert values(batch({"x": [1, 2, 3]}, 3, keep={"double": lambda found: 2 * np.array(found["x"])})) == {
            "double": [2.0, 4.0, 6.0]
        }

    def test_what_is_not_one_row_a_sample(self, solo: rbd.Robot, held: rbd.Actuation):
        """Scalars, other lengths, and answers at one state."""
        many = rbd.solve_many(solo, solo.standing().q, None, held.tau, solo.feet())
        for result, message in (
            (1.0, r"samples 1000 to 1002: 'value' has shape \(\) for 3 samples"),
            ({"x": np.zeros(2)}, r"'x' has shape \(2,\) for 3 samples"),
            (held, "returned an Actuation, of one sample; expected one row a sample"),
            (many, "a Solutions of 1 states for 3 samples"),
        ):
            with pytest.raises(rbd.InputError, match=message):
                batch(result, 3)
        with pytest.raises(rbd.InputError, match="returned a Solutions, of many states. Set batched=True"):
            kept(many)


def test_records_survive_a_store(solo: rbd.Robot, tmp_path: Path):
    """Labels, units, codes and text are the same from memory and from a file, beside a sample without a result."""
    for module in ("xarray", "zarr"):
        pytest.importorskip(module)
    state = solo.standing()

    def stand(friction: float) -> rbd.Actuation:
        return rbd.hold(state, solo.feet(friction=friction))

    keep = ("tau", "forces", "friction_used", "worst_motor", {"least": lambda held: held.margins.torque.min()})
    options: dict[str, Any] = {"keep": keep, "executor": 0, "progress": False}
    samples = rbd.grid(friction=[0.3, -1.0, 0.9])
    there = rbd.study(stand, samples, out=tmp_path / "stand.zarr", **options)
    here = rbd.study(stand, samples, **options)
    assert there.equals(here) and there.ok.values.tolist() == [True, False, True]
    for name, variable in here.variables.items():
        assert {k: np.array(x).tolist() for k, x in there[name].attrs.items()} == {
            k: np.array(x).tolist() for k, x in variable.attrs.items()
        }, name
    assert there.tau.sel(motor="FL_KFE").units == "N m" and there.worst_motor.values[0] in solo.actuated_names


def test_errors_are_rows():
    """The reason and the message of what the function raised; what was not put has not run."""
    rows = KeptRows(3, OutputSelection(None), first=10)
    rows.refuse(0, rbd.InputError("friction is -1."))
    rows.refuse(1, ValueError("x" * 5000))
    block = Found(rows.block())
    assert block.reason.tolist() == [Reason.BAD_INPUT.code, Reason.OTHER_ERROR.code, Reason.NOT_RUN.code]
    assert block.messages[10] == "friction is -1." and block.messages[11].startswith("ValueError: xxx")
    assert len(block.messages[11]) == 1000 and block.messages[11].endswith("x ...") and not block.ok.any()


def test_texts_of_errors():
    """Notes are told; without a text it is the class; a text that cannot be made loses nothing."""

    class Mute(ValueError):
        def __str__(self) -> str:
            raise RuntimeError

    noted = ValueError("friction is -1")
    noted.add_note("in sample 3")
    told = [text_of(error) for error in (noted, SystemExit(), Mute(), rbd.InputError("It is wrong."))]
    assert told == [
        "ValueError: friction is -1\nin sample 3",
        "SystemExit",
        "Mute: its text cannot be read",
        "It is wrong.",
    ]


def test_the_largest_circle_in_a_polygon():
    """Of a square half its side, of a triangle 2 area / circumference, in any plane; of a segment none."""
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    assert inscribed_radius(square) == pytest.approx(0.5) and inscribed_radius(square[:2]) == 0.0
    triangle = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 4.0]])
    assert inscribed_radius(triangle) == pytest.approx(1.0)


def test_internal_messages_reach_users_as_input_errors():
    """What cannot be kept is an `InputError` that names the sample."""
    with pytest.raises(NotKept, match=re.escape("sample 5: ")):
        kept(None, first=5)


def test_attributes_of_variables():
    """Only those that there are."""
    assert Variable(np.zeros(1)).attributes == {}
    assert Variable(np.zeros(1), units="N").attributes == {"units": "N"}


def test_the_largest_circle_in_a_polygon_whose_corners_go_clockwise() -> None:
    """Of 6 m by 2 m, off the origin: 1 m."""
    corners = np.array([[0.0, 2.0], [6.0, 2.0], [6.0, 0.0], [0.0, 0.0]]) + [5.0, -7.0]
    assert inscribed_radius(corners) == pytest.approx(1.0, abs=1e-9)
