"""Forces that a motion allows, point by point: each mode, and the law of Coulomb written down once more."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.arrays import Array
from rbd.problem.cones import Bounds, Free, FrictionCone, NonNegative, Product
from rbd.problem.contact_motion import REST_SPEED
from rbd.problem.corner_cones import WrenchCone
from rbd.problem.force_set import ForceSet
from rbd.problem.motion_forces import Refused, allowed_forces, given_weights, narrowed, refusal_words

MU = 0.5
STILL = 1e-9
CORNERS = np.array([[0.2, 0.1, 0.0], [0.2, -0.1, 0.0], [-0.2, -0.1, 0.0], [-0.2, 0.1, 0.0]])


def sets_of(*cones: rbd.problem.Cone, velocity: Array | None = None) -> ForceSet:
    """Rows r0, r1, ... with the identity for a Jacobian."""
    rows = []
    for i, cone in enumerate(cones):
        given = {} if velocity is None else {"velocity": np.array(velocity, float)}
        rows.append(rbd.Rows(f"r{i}", np.eye(cone.dim), np.zeros(cone.dim), cone, **given))
    return ForceSet.of(rows)


def allowed(sets: ForceSet, c: Array, margin: float = 0.0) -> tuple[ForceSet, tuple[Refused, ...]]:
    """Of the accelerations of the rows."""
    y = sets.accelerations(np.asarray(c, float))
    return allowed_forces(sets, y, np.full(len(y), STILL), margin)


def forces(sets: ForceSet, rng: np.random.Generator) -> Array:
    """A force that the sets allow, drawn: weights within their bounds, tangents within their cones."""
    w = rng.uniform(0.0, 2.0, sets.size)
    w = np.where(np.isfinite(sets.lower) | np.isfinite(sets.upper), w, rng.normal(size=sets.size))
    w = np.minimum(np.maximum(w, sets.lower), sets.upper)
    for (t, s, n), mu in zip(sets.cone_columns, sets.mu, strict=True):
        w[n] = rng.uniform(0.1, 2.0)
        angle, radius = rng.uniform(0, 2 * np.pi), rng.uniform(0.0, 1.0)
        w[[t, s]] = mu * w[n] * radius * np.array([np.cos(angle), np.sin(angle)])
    return np.asarray(sets.G @ w)


class TestPoints:
    """One point of friction 0.5."""

    def test_one_that_keeps_still_may_feel_any_force_of_its_cone(self):
        """C = 0: the same sets, or with a margin those of less friction."""
        sets = sets_of(FrictionCone(MU))
        same, refused = allowed(sets, [0.0, 0.0, 0.0])
        assert same is sets and refused == ()
        less, _ = allowed(sets, [0.0, 0.0, 0.0], margin=0.2)
        assert less.mu == pytest.approx([0.4]) and np.array_equal(less.G, sets.G) and less.elements[0].mu == pytest.approx(0.4)

    def test_what_is_rounding_is_still(self):
        """Up to what counts as zero it keeps still, in each direction; beyond, it does not."""
        sets = sets_of(FrictionCone(MU))
        for at in range(3):
            c = np.zeros(3)
            for sign in (1.0, -1.0):
                c[at] = 0.99 * STILL * sign
                found, refused = allowed(sets, c)
                assert found.size == 3 and refused == ()
                c[at] = 1.01 * STILL * sign
                found, refused = allowed(sets, c)
                assert found.size == 1 or refused

    def test_each_direction_has_its_own_zero(self):
        """The tangents' is what slips, the normal's what sinks or opens."""
        sets, still = sets_of(FrictionCone(MU)), np.array([1e-6, 1e-6, 1e-3])
        for c, size in (((0.0, 0.0, 1e-4), 3), ((0.0, 0.0, 1e-2), 1), ((1e-7, 0.0, 1e-4), 3), ((1e-4, 0.0, 1e-4), 1)):
            found, refused = allowed_forces(sets, sets.accelerations(np.array(c)), still)
            assert found.size == size and refused == ()
        for along, c_n in ((0.0, -1e-4), (1e-4, -1e-4), (1e-4, 1e-4)):
            found, refused = allowed_forces(sets, np.array([along, 0.0, c_n]), still)
            assert refused == () and found.upper[-1] == np.inf  # pressed, whether it slips or not
        assert len(allowed_forces(sets, np.array([0.0, 0.0, -1e-2]), still)[1]) == 1

    def test_one_that_opens_carries_nothing(self):
        """c_n > 0, whatever it does along the ground."""
        for along in (0.0, 3.0):
            found, refused = allowed(sets_of(FrictionCone(MU)), [along, 0.0, 0.2])
            assert refused == () and (found.lower == found.upper).all() and not found.lower.any()

    def test_one_that_starts_to_slip_rubs_against_its_slip(self):
        """c_n = 0, c_t = (3, 4): f = N (-mu 0.6, -mu 0.8, 1), the whole coefficient, margin or not."""
        for margin in (0.0, 0.05):
            found, refused = allowed(sets_of(FrictionCone(MU)), [3.0, 4.0, 0.0], margin)
            assert refused == () and found.size == 1 and (found.lower, found.upper) == ([0.0], [np.inf])
            assert found.G[:, 0] == pytest.approx([-MU * 0.6, -MU * 0.8, 1.0], abs=1e-15)

    def test_one_that_sinks_is_refused(self):
        """c_n < 0: by its number, with how fast."""
        _, refused = allowed(sets_of(FrictionCone(MU)), [0.0, 0.0, -0.25])
        assert refused == (Refused(0, 0, 1, False, -0.25),)

    def test_one_that_slides_rubs_against_its_velocity(self):
        """U = (-1, 0): f = N (mu, 0, 1) whatever c_t; it may open, and must not sink."""
        sets = sets_of(FrictionCone(MU), velocity=[-1.0, 0.0, 0.0])
        for c_t in (-2.0, 0.0, 5.0):
            found, refused = allowed(sets, [c_t, 1.0, 0.0], 0.05)
            assert refused == () and found.G[:, 0] == pytest.approx([MU, 0.0, 1.0]) and found.upper == [np.inf]
        opens, refused = allowed(sets, [0.0, 0.0, 0.3])
        assert refused == () and opens.upper == [0.0]
        _, refused = allowed(sets, [0.0, 0.0, -0.3])
        assert len(refused) == 1 and not refused[0].holds

    def test_one_that_moves_away_carries_nothing(self):
        """A velocity along the normal has opened it: any acceleration is allowed."""
        sets = sets_of(FrictionCone(MU), velocity=[0.0, 0.0, 10.0 * REST_SPEED])
        for c_n in (-1.0, 0.0, 1.0):
            found, refused = allowed(sets, [0.0, 0.0, c_n])
            assert refused == () and not (found.G @ np.where(np.isfinite(found.upper), found.upper, 1.0)).any()


class TestRows:
    """Rows without friction."""

    def test_a_bilateral_row_holds_or_is_refused(self):
        """C = 0: any force; else it is no motion of this robot."""
        sets = sets_of(Free(2))
        found, refused = allowed(sets, [0.0, 0.0])
        assert found is sets and refused == ()
        for c in (1e-3, -1e-3):
            _, refused = allowed(sets, [0.0, c])
            assert [(r.rows, r.holds, r.acceleration) for r in refused] == [(0, True, c)]

    def test_a_stop_opens_or_is_refused(self):
        """A half-line: away from it no force, into it never."""
        found, refused = allowed(sets_of(NonNegative(1)), [0.4])
        assert refused == () and (found.lower, found.upper) == ([0.0], [0.0])
        _, refused = allowed(sets_of(NonNegative(1)), [-0.4])
        assert [(r.holds, r.acceleration) for r in refused] == [(False, -0.4)]

    def test_an_interval_yields_at_its_bound(self):
        """Dry friction of a joint within -1 and 2 N m: c > 0 gives the lower bound, c < 0 the upper, c = 0 any between."""
        sets = sets_of(Bounds([-1.0], [2.0]))
        for c, low, high in ((0.3, -1.0, -1.0), (-0.3, 2.0, 2.0), (0.0, -1.0, 2.0)):
            found, refused = allowed(sets, [c])
            assert refused == () and (found.lower, found.upper) == ([low], [high])


class TestSeveral:
    """Patches, and rows of several kinds."""

    def test_each_corner_of_a_sole_has_its_own_mode(self):
        """A sole that tips about its edge at y = -0.1: two corners keep still, two open."""
        sets = sets_of(WrenchCone(CORNERS, MU))
        found, refused = allowed(sets, [0.0, 0.0, 0.1, 1.0, 0.0, 0.0], 0.05)  # c_n = 0.1 + y
        assert refused == () and len(found.mu) == 2 and found.mu == pytest.approx([0.95 * MU] * 2)
        opened = [e.number for e in found.elements if e.size == 1]
        assert opened == [0, 3]
        _, refused = allowed(sets, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
        assert [(r.number, r.of, r.acceleration) for r in refused] == [(1, 4, -0.1), (2, 4, -0.1)]

    def test_what_is_left_keeps_its_places(self, rng):
        """Columns of each constraint, bounds, and coefficients, of five kinds at once."""
        sets = sets_of(Free(1), FrictionCone(0.3), Product([FrictionCone(0.4), NonNegative(1)]), Bounds([-1.0], [1.0]))
        found, refused = allowed(sets, [0.0, *(1.0, 0.0, 0.0), *(0.0, 0.0, 0.0), 0.5, 0.2])
        assert refused == ()
        assert [s.stop - s.start for s in found.slices] == [1, 1, 4, 1]
        assert found.mu == pytest.approx([0.4]) and found.elements[found.slices[2].start].is_cone
        f = forces(found, rng)
        assert f[1:4] == pytest.approx(f[3] * np.array([-0.3, 0.0, 1.0])) and f[7] == 0.0 and f[8] == -1.0
        assert np.hypot(f[4], f[5]) <= 0.4 * f[6]

    @pytest.mark.parametrize("margin", [0.0, 0.1])
    def test_all_that_is_allowed_satisfies_coulombs_law(self, rng, margin):
        """Drawn modes and drawn forces of them: f in the cone, f_n c_n = 0, friction against the slip; weights come back."""
        modes = set()
        for _ in range(200):
            count = int(rng.integers(1, 4))
            mu = rng.uniform(0.1, 1.0, count)
            sets = sets_of(*[FrictionCone(float(m)) for m in mu])
            c = np.zeros((count, 3))
            for i in range(count):
                mode = int(rng.integers(3))
                c[i] = ([0.0, 0.0, 0.0], [*rng.normal(size=2), 0.0], [*rng.normal(size=2), rng.uniform(0.1, 1.0)])[mode]
                modes.add(mode)
            found, refused = allowed(sets, c.ravel(), margin)
            assert refused == ()
            w = np.linalg.lstsq(found.G, forces(found, rng), rcond=None)[0]
            f = (found.G @ w).reshape(-1, 3)
            for f_i, c_i, m in zip(f, c, mu, strict=True):
                tangential = np.hypot(f_i[0], f_i[1])
                assert f_i[2] >= 0.0 and tangential <= m * f_i[2] + 1e-12 and abs(f_i[2] * c_i[2]) < 1e-12
                if c_i[2] == 0.0 and c_i[:2].any():
                    assert f_i[:2] == pytest.approx(-m * f_i[2] * c_i[:2] / np.hypot(*c_i[:2]), abs=1e-12)
                elif not c_i.any():
                    assert tangential <= (1.0 - margin) * m * f_i[2] + 1e-12
            assert sets.G @ given_weights(sets, found, w) == pytest.approx(f.ravel(), abs=1e-12)
        assert modes == {0, 1, 2}

    def test_weights_come_back_from_pyramids_too(self, rng):
        """Of a pyramid inside a cone: the same force as weights of the cone."""
        sets = sets_of(FrictionCone(MU), WrenchCone(CORNERS, 0.3))
        inside = narrowed(sets, 0.1).with_pyramids(inscribed=True)
        w = rng.uniform(0.0, 1.0, inside.size)
        assert sets.G @ given_weights(sets, inside, w) == pytest.approx(inside.G @ w, abs=1e-12)


def test_a_margin_leaves_what_has_no_friction_alone():
    """Of rows without cones it changes nothing; the same sets give the same narrowed ones."""
    held = sets_of(Free(3), NonNegative(1))
    assert narrowed(held, 0.2) is held
    sets = sets_of(FrictionCone(MU))
    assert narrowed(sets, 0.2) is narrowed(sets, 0.2) and narrowed(sets, 0.0) is sets


def test_what_cannot_move_so_is_told_by_its_worst_point():
    """One point of each constraint, the fastest; held rows in other words; after six the rest are counted."""
    two = [Refused(0, 1, 4, False, -0.1), Refused(0, 2, 4, False, -0.3), Refused(1, 0, 1, True, 2.0)]
    assert refusal_words(two, ["sole", "loop"]) == (
        "'sole' (point 3 of 4) would sink at 0.3, 'loop' is held, and would accelerate at 2"
    )
    many = [Refused(i, 0, 1, False, -1.0) for i in range(9)]
    assert refusal_words(many, [f"c{i}" for i in range(9)]).endswith("'c5' (point 1 of 1) would sink at 1 and 3 more")
