"""Makes docs/pictures/*.png: `make pictures`, with Chromium on PATH."""

import contextlib
import importlib
import io
import sys
import tempfile
from pathlib import Path

from matplotlib.figure import Figure

import rbd
from rbd.visual import Scene, contact_sheet, screenshot

PICTURES = Path(__file__).resolve().parent
TOP = PICTURES.parents[1]
STANDING = ("talos", "g1", "romeo", "icub", "human", "solo12", "anymal_c", "go2", "bolt")


def talos() -> Path:
    """The README's first screen: Talos pushed at its torso, with the forces of the README's code."""
    robot = rbd.load_robot("talos")
    state, soles = robot.standing(), robot.soles(friction=0.7)
    push = rbd.ExternalForce("torso_2_link", (0.0, 80.0, 0.0))
    solution = rbd.solve(state, rbd.hold(state, soles).tau, soles, external=push)
    with tempfile.TemporaryDirectory() as folder, Scene(robot) as scene:
        scene.show(state, solution, external=push)
        page = scene.export(Path(folder) / "talos.html")
        return screenshot(page, PICTURES / "talos.png", width=1100, height=900)


def push() -> Path:
    """The plot of examples/02_push.py."""
    sys.path.insert(0, str(TOP / "examples"))
    example = importlib.import_module("02_push")
    with contextlib.redirect_stdout(io.StringIO()):
        result = example.main(show=False)
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    example.plot_push(figure.subplots(), result)
    figure.savefig(PICTURES / "push.png", dpi=110, metadata={"Software": None})
    return PICTURES / "push.png"


def two_laws() -> Path:
    """The plot of examples/04_two_laws.py."""
    sys.path.insert(0, str(TOP / "examples"))
    example = importlib.import_module("04_two_laws")
    with contextlib.redirect_stdout(io.StringIO()):
        result = example.main(show=False)
    figure = Figure(figsize=(8.6, 3.8), layout="constrained")
    example.plot_laws(figure.subplots(1, 2), result)
    figure.savefig(PICTURES / "two_laws.png", dpi=110, metadata={"Software": None})
    return PICTURES / "two_laws.png"


def sensitivities() -> Path:
    """The plot of examples/07_sensitivities.py."""
    sys.path.insert(0, str(TOP / "examples"))
    example = importlib.import_module("07_sensitivities")
    with contextlib.redirect_stdout(io.StringIO()):
        result = example.main(show=False)
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    example.plot_sensitivity(figure.subplots(), result)
    figure.savefig(PICTURES / "sensitivities.png", dpi=110, metadata={"Software": None})
    return PICTURES / "sensitivities.png"


def fists() -> Path:
    """The page of examples/05_moving_and_body_contacts.py: two robots in one model."""
    sys.path.insert(0, str(TOP / "examples"))
    example = importlib.import_module("05_moving_and_body_contacts")
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        example.main(show=True)
        page = next(Path(folder).rglob("*.html"))
        return screenshot(page, PICTURES / "fists.png", width=1100, height=900)


def unique() -> Path:
    """The plot of examples/08_what_is_unique.py."""
    sys.path.insert(0, str(TOP / "examples"))
    example = importlib.import_module("08_what_is_unique")
    with contextlib.redirect_stdout(io.StringIO()):
        result = example.main(show=False)
    figure = Figure(figsize=(8.0, 6.4), layout="constrained")
    example.draw(figure.subplots(2, sharex=True), result)
    figure.savefig(PICTURES / "unique.png", dpi=110, metadata={"Software": None})
    return PICTURES / "unique.png"


def robots() -> Path:
    """The contact sheet: nine robots at rest on their feet, with the forces that carry them."""
    return contact_sheet(STANDING, PICTURES / "robots.png")


if __name__ == "__main__":
    for make in (talos, push, two_laws, sensitivities, fists, robots):
        print(make().relative_to(TOP))
