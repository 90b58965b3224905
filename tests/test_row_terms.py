"""Rows of bodies in contact, compiled: inertia factor, mobility and the motion that holds them, beside dense algebra."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from rbd.answers.prepared.contact_bodies import Site, Workspace
from rbd.arrays import Array


def tree(rng: np.random.Generator) -> pin.Model:
    """A random tree of joints of all kinds, the first of them free, with rotor inertias."""
    kinds = [
        pin.JointModelFreeFlyer(), pin.JointModelSpherical(), pin.JointModelPlanar(), pin.JointModelRY(), pin.JointModelPX(),
        pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])), pin.JointModelRUBZ(), pin.JointModelTranslation(),
        pin.JointModelSphericalZYX(), pin.JointModelUniversal(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])),
    ]  # fmt: skip
    model = pin.Model()
    for i, kind in enumerate(kinds):
        parent = i
        while parent > 1 and rng.random() < 0.3:  # subtrees have consecutive numbers, as `pin.crba` takes for granted
            parent = model.parents[parent]
        joint = model.addJoint(parent, kind, pin.SE3.Random(), f"j{i}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Random())
    model.armature = rng.uniform(0.0, 0.3, model.nv)
    return model


def reference(model: pin.Model, sites: list[Site], q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
    """(M, h, J, J_dot v) by Pinocchio's frames."""
    data = model.createData()
    M = np.triu(pin.crba(model, data, q))
    h = pin.nonLinearEffects(model, data, q, v).copy()
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    pin.computeJointJacobians(model, data, q)
    J, drift = [], []
    for site in sites:
        axes = pin.LOCAL_WORLD_ALIGNED if site.size == 3 and site.axes is None else pin.LOCAL
        J.append(pin.getFrameJacobian(model, data, site.joint, site.X_JC, axes)[: site.size])
        drift.append(pin.getFrameClassicalAcceleration(model, data, site.joint, site.X_JC, axes).vector[: site.size])
    return M + np.triu(M, 1).T, h, np.vstack(J), np.concatenate(drift)


def sites_of(model: pin.Model, rng: np.random.Generator, joints: list[int]) -> list[Site]:
    """One place on each joint's body, of each kind in turn."""
    sizes = [(6, None), (3, None), (3, 0)]
    return [Site(j, pin.SE3.Random(), *sizes[i % 3]) for i, j in enumerate(joints)]


def case(seed: int) -> tuple[pin.Model, list[Site], Array, Array, Array]:
    """A tree, places on up to three of its bodies, a state and generalised forces."""
    pin.seed(seed)
    rng = np.random.default_rng(seed)
    model = tree(rng)
    kinds = [(6, None), (3, None), (3, 0)]
    sites = [Site(j, pin.SE3.Random(), *kinds[i]) for i, j in enumerate([10, 1, 5][: 1 + seed % 3])]
    q = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    return model, sites, q, rng.normal(size=model.nv), rng.normal(size=model.nv)


@pytest.mark.parametrize("seed", range(9))
def test_terms_of_any_tree(seed: int):
    """Mobility, velocities, and the motion that holds the rows with its forces, at any velocity."""
    model, sites, q, v, generalised = case(seed)
    M, h, J, drift = reference(model, sites, q, v)
    space = Workspace(model, sites)
    a = space.held(q, v, generalised)
    assert a is not None
    K = np.block([[M, -J.T], [J, np.zeros((len(J), len(J)))]])
    x = np.linalg.solve(K, np.concatenate([generalised - h, -drift]))
    bound = 100.0 * np.finfo(float).eps * np.linalg.cond(K) * np.abs(x).max()
    assert np.abs(a - x[: model.nv]).max() <= bound and np.abs(space.row_forces - x[model.nv :]).max() <= bound
    mobility = J @ np.linalg.solve(M, J.T)
    assert np.abs(space.mobility - mobility).max() <= 1e-14 * np.linalg.cond(M) * np.abs(mobility).max()
    assert np.abs(space.row_rates - J @ v).max() <= 1e-12 * max(1.0, np.abs(J @ v).max())


def test_rows_that_depend_on_each_other_are_not_held():
    """Two places on one body have twelve rows, of which six depend on the others."""
    model, _, q, v, generalised = case(0)
    assert Workspace(model, [Site(10, pin.SE3.Random(), 6), Site(10, pin.SE3.Random(), 6)]).held(q, v, generalised) is None


def test_numbers_that_are_none_are_not_held():
    """NaN in the forces, or an inertia that is not positive, gives no motion."""
    model, sites, q, v, generalised = case(1)
    model.armature = -1e3 * np.ones(model.nv)
    assert Workspace(model, sites).held(q, v, generalised) is None


def test_another_rotor_inertia():
    """A model with other rotor inertias in place of the robot's has its own mobility."""
    model, sites, q, v, generalised = case(2)
    heavier = pin.Model(model)
    heavier.armature = model.armature + 2.0
    space = Workspace(model, sites)
    a = space.held(q, v, generalised, heavier)
    own = Workspace(heavier, sites).held(q, v, generalised)
    assert a is not None and own is not None and np.array_equal(a, own)
