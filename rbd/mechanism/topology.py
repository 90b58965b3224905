"""Serial or branched, open or closed, parallel or hybrid; mobility, and redundancy of an end point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rbd.arrays import Array, check_seed, max_abs
from rbd.constraints.constraint import Constraint, frames_of
from rbd.constraints.manifold import ConstraintManifold, LinearisedRows, null_space, rank_of
from rbd.displayed import Displayed
from rbd.errors.inputs import listed_items
from rbd.mechanism.degrees_of_freedom import FAR, ROUGH, neighbours
from rbd.mechanism.four_bar_class import FourBarClass, four_bar_pins
from rbd.model.checked_model import CheckedModel
from rbd.model.inertial import body_names
from rbd.model.state import State, checked
from rbd.records import joined

if TYPE_CHECKING:
    from scipy.sparse import csr_array

GROUND = "the ground"


@dataclass(frozen=True)
class EndPoint:
    """An end point: its degrees of freedom, and its redundancy.

    Attributes:
        frame: Its frame.
        position_dof: Degrees of freedom of its position, generically.
        pose_dof: Degrees of freedom of its position and orientation together.
        mobility: Degrees of freedom of the joints between it and the root of the file's tree, under the constraints; the
            other arm and the fingers are not counted.
        position_redundancy: That less `position_dof`: motions of its chain that do not change its position.
        pose_redundancy: Mobility less `pose_dof`: motions of its chain that do not change its pose.
        legs: Chains from the base to its body that share no body in between.
        singular: Whether it has fewer degrees of freedom at the configuration looked at than nearby.
    """

    frame: str
    position_dof: int
    pose_dof: int
    mobility: int
    legs: int
    singular: bool

    @property
    def position_redundancy(self) -> int:
        """`mobility` less `position_dof`."""
        return self.mobility - self.position_dof

    @property
    def pose_redundancy(self) -> int:
        """`mobility` less `pose_dof`."""
        return self.mobility - self.pose_dof

    def __str__(self) -> str:
        legs = f"{self.legs} legs join it to the base" if self.legs > 1 else "one chain joins it to the base"
        low = " (fewer at the configuration looked at, which is singular)" if self.singular else ""
        return (
            f"end point {self.frame}: {self.mobility} degrees of freedom of its chain, {self.position_dof} of its position, "
            f"{self.pose_dof} of position and orientation{low}: redundancy {self.position_redundancy} and "
            f"{self.pose_redundancy}; {legs}"
        )


@dataclass(frozen=True, eq=False, repr=False)
class MechanismClass(Displayed):
    """Classification of a mechanism: serial, branched, parallel or hybrid, with its mobility, as `classify` finds it.

    Attributes:
        name: The robot's name.
        kind: "serial": an open chain without branches, from the base to one end. "branched": open, with branches.
            "parallel": closed, and every moving body is joined to the base by two chains or more. "hybrid": closed, with
            bodies joined to the base by only one chain.
        loops: Independent loops; open chains have none.
        base: Base of the chain: "the ground", or the root link of a floating robot without contacts.
        ends: Links at the ends of the tree of the file.
        bodies: Bodies that move, fixed joints merged.
        degrees_of_freedom: Degrees of freedom of the joints, a floating base among them: n.
        mobility: n - rank J, generically: at configurations nearby that satisfy the constraints. None where no
            configuration was found that does.
        floating: Whether the file's robot floats.
        end_points: The end points requested.
        q: The configuration that was examined, or None.
        four_bar: Its class by Grashof's condition, of a planar four-bar alone; None of all others. The input is the bar on the
            ground with a motor.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 2.5, 3.0)
        >>> found = rbd.mechanism.classify(robot.at("assembled"))
        >>> found.kind, found.loops, found.bodies, found.mobility, found.four_bar.kind
        ('parallel', 1, 3, 1, 'crank-rocker')
    """

    name: str
    kind: str
    loops: int
    base: str
    ends: tuple[str, ...]
    bodies: int
    degrees_of_freedom: int
    mobility: int | None
    floating: bool
    end_points: tuple[EndPoint, ...]
    q: Array | None
    four_bar: FourBarClass | None = None

    @property
    def closed(self) -> bool:
        """Whether there is a loop."""
        return self.loops > 0

    def __str__(self) -> str:
        loops = f"closed, with {self.loops} independent {'loop' if self.loops == 1 else 'loops'}" if self.loops else "open"
        six = ", 6 of them those of a floating base" if self.floating else ""
        lines = [
            f"{self.name} is a {self.kind} chain: {loops}. Its base is {self.base}; the tree of its file ends at "
            f"{joined(self.ends)}.",
            f"{self.bodies} moving bodies; {self.degrees_of_freedom} degrees of freedom of its joints{six}.",
        ]
        if self.mobility is None:
            lines.append("Mobility unknown: no configuration was found that satisfies the constraints.")
        elif self.mobility == self.degrees_of_freedom:
            lines.append(f"Mobility {self.mobility}: no constraint removes any.")
        else:
            lines.append(f"Mobility {self.mobility}: constraints remove {self.degrees_of_freedom - self.mobility}.")
        if self.four_bar is not None:
            lines.append(f"As a four-bar it is a {self.four_bar}.")
        return "\n".join([*lines, *(str(end)[0].upper() + str(end)[1:] + "." for end in self.end_points)])


def classify(
    state: State,
    constraints: Sequence[Constraint] | None = None,
    *,
    end: str | Sequence[str] = (),
    seed: int = 0,
    loops: bool = True,
) -> MechanismClass:
    """Class of a robot (serial, branched, parallel or hybrid), its mobility, and redundancy of its end points.

    Bodies are joined by the joints of the file and by constraints between two bodies or with the ground: closures of loops,
    bilateral contacts, but not by rolling or sliding contacts. A floating base is not a joint here: a humanoid on two soles is
    closed through the ground, and in the air it is a branched chain from its root link. Other constraints remove degrees of
    freedom without closing a loop.

    Mobility is the total number of degrees of freedom; redundancy of an end point is the mobility of its chain
    less its degrees of freedom. Both are generic: the largest ranks at the configuration, and at others nearby (drawn
    freely if there are no loops).

    Args:
        state: The configuration, projected onto the constraints if it is off them. Its velocity is not used.
        constraints: Bilateral constraints; None for the loops and wheels of the robot's file.
        end: Frames of end points, one or several.
        seed: Of the configurations examined.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        FrameNotFound: with the nearest names.
        InputError: not a state.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> found = rbd.mechanism.classify(solo.standing(), solo.feet(friction=None), end="base_link")
        >>> found.kind, found.loops, found.mobility
        ('parallel', 3, 6)
    """
    seed = check_seed(seed)
    robot = checked(state).robot
    frames = listed_items("end", end, "a frame's name, or a list of them", alone=True)
    for frame in frames:
        robot.frame_id(frame)
    held = ConstraintManifold(state, constraints, loops=loops)
    rolling = {name for (name, _), placed in zip(held.names, held.placed, strict=True) if not placed}
    graph = Graph(robot, [c for c in held.constraints if c.name not in rolling])
    looked = _configurations(held, seed)
    mobility = min((null_space(p.A, ROUGH)[0].shape[1] for p in looked), default=None)
    ends = tuple(_end_point(held, looked, frame, graph) for frame in frames if looked)
    pins = four_bar_pins(state, held.constraints)
    links = ("", *body_names(robot))
    base = GROUND if graph.base == 0 else links[graph.base]
    leaves = [j for j in range(1, robot.model.njoints) if j not in set(robot.model.parents.tolist()[1:])]
    return MechanismClass(
        robot.name, graph.kind, graph.loops, base, tuple(links[j] for j in leaves), robot.model.njoints - 1, robot.nv,
        mobility, robot.floating, ends, looked[0].q if looked else None, pins and pins.classified(state),
    )  # fmt: skip


class Graph:
    """Graph of bodies (0 the ground, else the index of their joint) and connections.

    Args:
        robot: The robot.
        constraints: Those whose rows are all of position.

    Attributes:
        edges: Pairs of bodies.
        base: The body from which chains are counted: the ground if there is contact with it, else the root of a floating robot.
    """

    def __init__(self, robot: CheckedModel, constraints: Sequence[Constraint]) -> None:
        model = robot.model
        floats = set(robot.bases)
        self.edges = [(int(model.parents[j]), j) for j in range(1, model.njoints) if j not in floats]
        for constraint in constraints:  # on joints and functions there are none; with one frame on the ground
            bodies = [*(robot.site(frame)[0] for frame in frames_of(constraint)), 0][:2]
            self.edges += [(bodies[0], bodies[1])] if bodies[0] != bodies[-1] else []
        touched = any(0 in edge for edge in self.edges)
        self.base = 0 if touched or not floats else min(floats)
        self.bodies = [j for j in range(1, model.njoints) if j != self.base]

    @property
    def loops(self) -> int:
        """Edges beyond those of a tree."""
        from scipy.sparse.csgraph import connected_components

        nodes = {self.base, *self.bodies, *(body for edge in self.edges for body in edge)}
        parts = connected_components(_network([(a, b, 1) for a, b in self.edges], max(nodes) + 1), directed=False)[0]
        alone = max(nodes) + 1 - len(nodes)  # numbers that are no bodies of the graph
        return len(self.edges) - len(nodes) + int(parts) - alone

    @property
    def kind(self) -> str:
        """Kind of the mechanism, see `MechanismClass`."""
        if not self.loops:
            degree = np.bincount(np.array(self.edges, dtype=int).ravel(), minlength=2) if self.edges else np.zeros(2, int)
            return "serial" if degree[self.base] <= 1 and degree.max(initial=0) <= 2 else "branched"
        return "parallel" if all(self.legs(body) > 1 for body in self.bodies) else "hybrid"

    def legs(self, body: int) -> int:
        """Number of chains to the base without common bodies: a maximum flow, by Menger's theorem."""
        from scipy.sparse.csgraph import maximum_flow

        nodes, many = {x for edge in self.edges for x in edge}, len(self.edges)
        n = max(nodes) + 1
        through = [(x, n + x, many if x in (self.base, body) else 1) for x in nodes]  # in, out: each body once
        ways = [(n + a, b, 1) for one, other in self.edges for a, b in ((one, other), (other, one))]
        return int(maximum_flow(_network([*through, *ways], 2 * n), n + self.base, body).flow_value)


def _network(ways: Sequence[tuple[int, int, int]], size: int) -> csr_array:
    """The graph of ways (from, to, capacity), as a matrix of capacities; those of parallel ways add up."""
    from scipy.sparse import csr_array

    start, end, capacity = np.array(ways, dtype=np.int32).reshape(-1, 3).T
    return csr_array((capacity, (start, end)), shape=(size, size), dtype=np.int32)


def _configurations(held: ConstraintManifold, seed: int) -> list[LinearisedRows]:
    """A configuration on the constraints, and some nearby."""
    rng, here = np.random.default_rng(seed), held.at(held.q)
    if max_abs(here.error) > held.tolerance:
        for draw in range(20):
            z = rng.uniform(-1.0, 1.0, size=held.n) * (draw > 0)
            here = held.project(held.move(held.q, z))
            if max_abs(here.error) <= 1e-10:
                break
        else:
            return []
    if not held.placed.any():
        return [here, *(held.at(held.move(here.q, rng.uniform(-1.0, 1.0, size=held.n))) for _ in range(3))]
    return [here, *(p for p in neighbours(held, here, FAR, rng, 6) if p is not None)]


def _end_point(held: ConstraintManifold, looked: list[LinearisedRows], frame: str, graph: Graph) -> EndPoint:
    body, ranks = held.robot.site(frame)[0], []
    chain = held.robot.joints.carrying(body) > 0.0
    for point in looked:
        N, _ = null_space(point.A, ROUGH)
        J = point.state.frame(frame).J.reshape(6, -1) * held.scale
        J[:3] /= held.robot.joints.length
        ranks.append([rank_of(np.linalg.svd(part @ N, compute_uv=False)) for part in (J[:3], J, np.eye(held.n)[chain])])
    position, pose, mobility = np.max(ranks, axis=0).tolist()
    return EndPoint(frame, position, pose, mobility, graph.legs(body), ranks[0][:2] != [position, pose])
