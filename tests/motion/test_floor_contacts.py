"""Contacts of a motion that is followed: when they begin, how long they last, and with which points."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from flat_bodies import free_body

import rbd
from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel
from rbd.motion.contact_timeline import LANDED, UNLOADED, ContactTimeline, FloorContacts, FloorPoints

MASS, GROUND, FRICTION, MARGIN = 5.0, 0.3, 0.8, 0.1
NEAR, FAR = 0.5 * LANDED, 2.0 * LANDED
CORNERS = np.array([[0.2, 0.1, -0.1], [0.2, -0.1, -0.1], [-0.2, 0.1, -0.1], [-0.2, -0.1, -0.1]])
KNOB = np.array([0.0, 0.0, 0.2])
"""A ball's centre on top of the box; it touches when the box is turned over [m]."""
RADIUS = 0.05
SOLE, TOP = 0, 1


class Knob:
    """What stands for the shapes of a body that is no foot."""

    name = "knob"


class Carried:
    """An answer with the forces of contacts."""

    def __init__(self, **forces: float) -> None:
        self.forces = {name.replace("_", " "): np.array([0.0, 0.0, f]) for name, f in forces.items()}


@pytest.fixture
def box() -> CheckedModel:
    """A box with a sole of four corners, and a knob on top."""
    return free_body(MASS, [0.1, 0.1, 0.1])


def contacts_of(box: CheckedModel, *wanted: str) -> FloorContacts:
    """Of a reference whose frames want the sole's corners 0 and 1: "" none, "sole" all four, "front" two."""
    sole = rbd.constraints.Contact("sole", "body", corners=CORNERS, friction=FRICTION)
    names = tuple(f"sole {i + 1}" for i in range(4)) + ("knob 1",)
    local, radius = np.vstack([CORNERS, KNOB]), np.array([0.0] * 4 + [RADIUS])
    points = FloorPoints(box, (sole, Knob()), names, np.array([SOLE] * 4 + [TOP]), np.full(5, 1), local, radius)
    rows = {"": [0, 0, 0, 0, 0], "sole": [1, 1, 1, 1, 0], "front": [1, 1, 0, 0, 0]}
    touches = np.array([rows[each] for each in wanted], bool)
    n = len(touches)
    none = np.zeros((n, 5))
    t, places, no = np.arange(n) * 0.1, np.zeros((n, 5, 3)), none > 0.0
    lanes = ContactTimeline(t, points, touches, no, none, none, places, GROUND, none, no)
    return FloorContacts(lanes, FRICTION, MARGIN)


def above(box: CheckedModel, height: float, pitch: float = 0.0, turned: bool = False) -> rbd.State:
    """The box with its lowest point of sole (of the knob, when turned over) at a height; the nose up by pitch."""
    R = pin.rpy.rpyToMatrix(np.pi if turned else 0.0, -pitch, 0.0)
    low = R[2] @ KNOB - RADIUS if turned else (CORNERS @ R[2]).min()
    return rbd.State(box, pin.SE3ToXYZQUAT(pin.SE3(R, np.array([1.0, 2.0, GROUND + height - low]))))


def test_a_planned_contact_begins_when_its_lowest_point_has_landed(box: CheckedModel) -> None:
    """Within a millimetre of the floor, with the points that the reference wants; it lasts while the reference wants it."""
    contacts = contacts_of(box, "", "sole", "front", "")
    assert contacts.update(above(box, FAR), 1).tolist() == [False, False] and not contacts.on.any()
    assert contacts.update(above(box, NEAR), 1).tolist() == [True, False]
    assert contacts.on.tolist() == [True] * 4 + [False]
    assert contacts.update(above(box, FAR), 1).tolist() == [True, False]  # once landed, it is held
    contacts.update(above(box, FAR), 2)
    assert contacts.on.tolist() == [True, True, False, False, False]
    assert contacts.update(above(box, NEAR), 3).tolist() == [False, False]  # as planned it ends, though near to the floor


def test_a_planned_contact_ends_as_planned_whatever_it_carries(box: CheckedModel) -> None:
    """Load holds a contact on only where the reference never wanted it."""
    contacts = contacts_of(box, "sole", "")
    contacts.on = contacts.lanes.touches[0].copy()
    contacts.update(above(box, 0.0), 0)
    contacts.carried(Carried(sole=MASS * 9.81))
    assert not contacts.update(above(box, 0.0), 1).any()


def test_what_sinks_lands_with_the_points_near_the_lowest(box: CheckedModel) -> None:
    """An unplanned contact begins a millimetre below the floor: with all corners when level, with two when pitched."""
    for height, pitch, expected in (
        (-NEAR, 0.0, [False] * 4),
        (-FAR, 0.0, [True] * 4),
        (-FAR, 0.1, [False, False, True, True]),
        (-FAR, -0.1, [True, True, False, False]),
        (-FAR, 0.8 * LANDED / 0.4, [True] * 4),
        (-FAR, 1.2 * LANDED / 0.4, [False, False, True, True]),
    ):
        contacts = contacts_of(box, "")
        assert contacts.update(above(box, height, pitch), 0).tolist() == [any(expected), False]
        assert contacts.on.tolist() == [*expected, False], (height, pitch)


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_what_landed_unplanned_stays_as_long_as_it_is_loaded(box: CheckedModel, share: float) -> None:
    """With more than a hundredth of the weight it stays where it rises a little; with less it ends."""
    contacts = contacts_of(box, "")
    contacts.update(above(box, -FAR, 0.1), 0)
    contacts.carried(Carried(sole=share * UNLOADED * MASS * 9.81, soles=1e3))
    found = contacts.update(above(box, 0.0, 0.1), 0)
    assert found.tolist() == [share > 1.0, False]
    assert contacts.on.tolist() == [False, False, share > 1.0, share > 1.0, False]


def test_forces_of_single_points_add_up_to_the_load(box: CheckedModel) -> None:
    """Two points with 0.8 % of the weight each hold what one of them would not."""
    contacts = contacts_of(box, "")
    contacts.update(above(box, -FAR, turned=True), 0)
    assert contacts.on.tolist() == [False] * 4 + [True]
    part = 0.8 * UNLOADED * MASS * 9.81
    contacts.carried(Carried(knob_1=part, knob_2=part, sole=-9.0))
    assert contacts.update(above(box, 0.0, turned=True), 0).tolist() == [False, True]
    contacts.carried(Carried(knob_1=part, sole=9.0))
    assert contacts.update(above(box, 0.0, turned=True), 0).tolist() == [False, False]


def test_what_the_reference_takes_over_is_its_own(box: CheckedModel) -> None:
    """What landed unplanned and is then planned ends as planned, though it is loaded."""
    contacts = contacts_of(box, "", "sole", "")
    contacts.update(above(box, -FAR), 0)
    contacts.carried(Carried(sole=MASS * 9.81))
    assert contacts.update(above(box, 0.0), 1).tolist() == [True, False]
    assert contacts.update(above(box, 0.0), 2).tolist() == [False, False]


def places(contact: rbd.constraints.Contact, state: rbd.State) -> Array:
    """Where the points of a contact are from the middle of the body, in W [m]."""
    X = state.base_pose() * contact.placement
    return contact.corners @ X.rotation.T + X.translation - state.q[:3]


def test_its_constraints_are_smaller_soles_with_less_friction(box: CheckedModel) -> None:
    """Corners that touch, drawn to their middle by the margin; friction less the margin; of a ball its lowest point."""
    contacts = contacts_of(box, "sole", "front")
    state = above(box, 0.0)
    assert contacts.constraints(state) == []
    contacts.update(state, 0)
    (sole,) = contacts.constraints(state)
    assert sole.name == "sole" and sole.friction == pytest.approx((1.0 - MARGIN) * FRICTION)
    assert np.allclose(places(sole, state), CORNERS * [1.0 - MARGIN, 1.0 - MARGIN, 1.0])
    assert contacts.constraints(state)[0] is sole  # what it computed stays with it
    contacts.update(state, 1)
    (front,) = contacts.constraints(state)
    assert np.allclose(np.sort(places(front, state), axis=0), np.sort(CORNERS[:2] * [1.0, 1.0 - MARGIN, 1.0], axis=0))
    over = above(box, -FAR, 0.3, turned=True)
    contacts = contacts_of(box, "")
    contacts.update(over, 0)
    (knob,) = contacts.constraints(over)
    assert knob.name == "knob 1" and knob.friction == pytest.approx((1.0 - MARGIN) * FRICTION)
    assert np.allclose(places(knob, over), over.base_pose().rotation @ KNOB - [0.0, 0.0, RADIUS], atol=1e-12)
