"""Options and arguments that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

PackageDirs = Annotated[list[Path] | None, typer.Option(help="Folder of package:// meshes; may be repeated.")]
Json = Annotated[Path | None, typer.Option("--json", help="Write all numbers.")]
Show = Annotated[bool, typer.Option("--show", help="Serve the picture at 127.0.0.1 until Ctrl-C.")]
Feet = Annotated[
    str | None, typer.Option("--feet", metavar="A,B", help="Frames of its feet; those of the catalogue by default.")
]
Gravity = Annotated[str | None, typer.Option(metavar="X,Y,Z", help="Gravity in the world, in m/s2; 0,0,-9.81 by default.")]
Friction = Annotated[float, typer.Option(help="Coulomb's coefficient at the feet.")]
Motion = Annotated[Path | None, typer.Option(help="Write the motion: one page that plays anywhere.")]
Law = Annotated[str, typer.Option(help="Law of contacts that slip: coulomb or convex.")]
RobotName = Annotated[str, typer.Argument(help="Name of a robot (talos, g1, ...) or path of a URDF.")]
Video = Annotated[Path | None, typer.Option(help="Write a video, .mp4 (wants ffmpeg) or .gif.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="Also print how long each part took.")]
Out = Annotated[Path | None, typer.Option(help="Store every result, .zarr (or .nc, of small studies).")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with a store that is there.")]
Workers = Annotated[int | None, typer.Option(metavar="N", help="Processes; one a core by default, 0: none but this one.")]
