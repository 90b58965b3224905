"""Cards of what is found of mechanisms: degrees of freedom, branches, singular configurations, poses."""

from __future__ import annotations

import math

import numpy as np

from rbd.mechanism.assembly import Assembly
from rbd.mechanism.assembly_modes import Branches
from rbd.mechanism.degrees_of_freedom import Mobility
from rbd.mechanism.pose_search import FoundPose
from rbd.mechanism.singular_configurations import KINDS, Singularities, SingularitiesAlong, Singularity
from rbd.mechanism.topology import MechanismClass
from rbd.visual.name_lists import joined
from rbd.visual.notebook.card import Card, Fold, Table
from rbd.visual.notebook.registry import card_of
from rbd.visual.notebook.values import number, words

_SINGULARITY_HEADS = ("kind", "singular", "ratio of singular values", "joints that move", "singular means")


@card_of.register
def _mobility(record: Mobility) -> Card:
    rows = [
        ("counted", str(record.count.value), record.count.formula),
        (
            "instantaneous",
            str(record.instantaneous),
            f"n - rank J = {record.velocities} - {record.rank}, of {record.rows} rows",
        ),
        ("finite", str(record.finite), "dimension of the motions that pass through here"),
    ]
    notes = [f"It moves although the count gives {record.count.value}: over-constrained."] if record.over_constrained else []
    s = record.singular_values
    proof = [
        ("singular values of J, largest", number(s.max(), 4) if len(s) else "-", "1"),
        ("smallest that counts", number(s[record.rank - 1], 4) if record.rank else "-", "1"),
        ("counts as zero below", f"{record.zero:.1e}", "of the largest"),
        ("directions tried, seed", f"{record.motion.tried}, {record.seed}", ""),
    ]
    redundant = Table([(str(row),) for row in record.redundant], ("redundant rows",), rest="mobility.redundant")
    folds = [Fold("Proof: ranks; numerical, not a proof in general", [Table(proof), redundant])]
    return Card(record.verdict, None, [Table(rows, ("degrees of freedom", "", "how"))], notes, folds)


@card_of.register
def _branches(record: Branches) -> Card:
    k = len(record)
    said = (
        f"{k} {'way' if k == 1 else 'ways'} to assemble it found in {record.tries} tries; that there are no more is not proved"
    )
    rows = []
    for i, branch in enumerate(record.found):
        marks = ["singular"] * branch.singular + [f"beyond its limits: {joint}" for joint in branch.beyond_limits]
        rows.append((f"branch {i}", joined(branch.joints, 5), f"{branch.hits}", f"{branch.residual:.1e}", joined(marks)))
    heads = ("branch", "joints", "hits", "residual [m, rad]", "remarks")
    counts = [("starts that closed", str(record.closed)), ("starts since the last new branch", str(record.since_new))]
    counts += [("seed", str(record.seed))]
    return Card(said, None, [Table(rows, heads, rest="branches.found")], record.skipped, [Fold("Search", [Table(counts)])])


def _row(s: Singularity) -> tuple[str, ...]:
    return s.kind, "yes" if s.singular else "no", number(s.distance, 3), joined(s.joints) if s.singular else "-", KINDS[s.kind]


@card_of.register
def _singularity(record: Singularity) -> Card:
    return Card(str(record), not record.singular, [Table([_row(record)], _SINGULARITY_HEADS)])


@card_of.register
def _singularities(record: Singularities) -> Card:
    found = record.singular
    said = f"singular: {joined(found)}" if found else "the configuration is regular, of all kinds examined"
    rows = [_row(s) for s in record.kinds.values()]
    return Card(said, not found, [Table(rows, _SINGULARITY_HEADS)], [f"Ranks nearby: from {record.points} configurations."])


@card_of.register
def _singularities_along(record: SingularitiesAlong) -> Card:
    said = f"{len(record.found)} singular configurations on the way" if record.found else "no singular configuration on the way"
    rows = [(number(s.at, 5), *_row(s)) for s in record.found]
    nearest = [(kind, number(d.min(), 3), f"{len(d)}") for kind, d in record.distances.items()]
    tables = [Table(rows, ("at index", *_SINGULARITY_HEADS)), Table(nearest, ("kind", "smallest distance", "configurations"))]
    return Card(said, not record.found, tables)


@card_of.register
def _class(record: MechanismClass) -> Card:
    moves = "not known" if record.mobility is None else str(record.mobility)
    rows = [
        ("mobility", moves, "degrees of freedom"),
        ("independent loops", str(record.loops), ""),
        ("bodies that move", str(record.bodies), ""),
        ("of its joints", str(record.degrees_of_freedom), "degrees of freedom"),
        ("base", record.base, ""),
        ("ends", joined(record.ends), ""),
    ]
    said = f"{record.name}: a {record.kind} mechanism, mobility {moves}"
    return Card(said, None, [Table(rows, ("of the mechanism", "", "unit"))], (), [Fold("As printed", [str(record)])])


@card_of.register
def _found_pose(record: FoundPose) -> Card:
    said = f"{record.state.robot.name}: pose found, {len(record.misses)} targets satisfied to {record.worst:.1e} m or rad"
    rows = [(name, f"{m.distance:.1e}", f"{math.degrees(m.angle):.1e}") for name, m in record.misses.items()]
    loops = [(name, f"{apart:.1e}") for name, apart in record.loops.items()]
    notes = [f"At a limit: {joined(record.at_limits)}."] if record.at_limits else []
    tables = [Table(rows, ("target", "missed by [m]", "turned by [deg]")), Table(loops, ("loop", "open by [m, rad]"))]
    return Card(said, True, tables, [*notes, f"Distance from the posture: {number(record.moved, 4)} m or rad."])


@card_of.register
def _assembly(record: Assembly) -> Card:
    first = str(record).split("\n", 1)[0]
    residual = float(np.abs(record.residual).max(initial=0.0)) if isinstance(record.residual, np.ndarray) else record.residual
    rows = [("q", words(record.q), "m, rad"), ("residual", words(residual), "m, rad")]
    return Card(first, None, [Table(rows, ("of the assembly", "value", "unit"))])
