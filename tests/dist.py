"""Build wheel and sdist, and run the demo from each, in an environment of its own away from the checkout; for `make dist`.

The exit code is 1 where the demo fails, or writes no page.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
DEMO = ("stand", "talos", "--push", "0,80,0", "--at", "torso_2_link", "--html", "talos.html")


def built(folder: Path) -> list[Path]:
    """Wheel and sdist of this tree, in a folder; what it held of them goes."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in (*folder.glob("rbd_contact-*.whl"), *folder.glob("rbd_contact-*.tar.gz")):
        old.unlink()
    code = "import sys; from hatchling import build as b; print(b.build_wheel(sys.argv[1]), b.build_sdist(sys.argv[1]))"
    done = subprocess.run([sys.executable, "-c", code, folder], cwd=TOP, capture_output=True, text=True, check=True)
    return [folder / name for name in done.stdout.split()]


def demo(artefact: Path, folder: Path) -> str:
    """Install into a new environment and run the demo; what it cost, in words.

    Raises:
        RuntimeError: a command failed, or there is no page.
    """
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    own, python = folder / "environment", folder / "environment" / "bin" / "python"

    def run(*command: str | Path) -> float:
        start = time.perf_counter()
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{' '.join(map(str, command))} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
        return time.perf_counter() - start

    run(sys.executable, "-m", "venv", own)
    installing = run(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", artefact)
    running = run(own / "bin" / "rbd", *DEMO)
    page = folder / "talos.html"
    if not page.is_file() or page.stat().st_size < 1_000_000:
        raise RuntimeError(f"the demo wrote no page with Talos in it: {page}")
    size = sum(path.stat().st_size for path in (own / "lib").rglob("*") if path.is_file() and not path.is_symlink())
    return f"installed in {installing:.0f} s, {size / 1e6:.0f} MB; the demo took {running:.1f} s"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=TOP / "dist", help="where wheel and sdist go")
    parser.add_argument("--build-only", action="store_true", help="do not run the demo")
    given = parser.parse_args(arguments)
    wrong = 0
    for artefact in built(given.folder.resolve()):
        told = ""
        if not given.build_only:
            with tempfile.TemporaryDirectory(prefix="rbd-dist-") as folder:
                try:
                    told = "; " + demo(artefact, Path(folder))
                except RuntimeError as error:
                    wrong, told = 1, f"; FAILED: {error}"
        print(f"{artefact.name}, {artefact.stat().st_size / 1e6:.2f} MB{told}", flush=True)
    return wrong


if __name__ == "__main__":
    sys.exit(main())
