"""`testbed view`: a picture of a machine, rendered without a screen."""

from __future__ import annotations

from pathlib import Path

import click

from testbed.cli._answer import Answer
from testbed.cli._places import check_place
from testbed.problem import InputProblem


@click.command(short_help="Render a picture of a machine.", epilog="Example: testbed view flexure -o rig.png")
@click.argument("machine", default="flexure")
@click.option("-o", "--output", default="rig.png", show_default=True, metavar="FILE.png", help="The picture to write.")
@click.option("--camera", default="overview", show_default=True, help="One of those the machine's MuJoCo model names.")
@click.option("--width", type=click.IntRange(16, 8192), default=1600, show_default=True, help="Pixels.")
@click.option("--height", type=click.IntRange(16, 8192), default=1200, show_default=True, help="Pixels.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def command(machine: str, output: str, camera: str, width: int, height: int, quiet: bool) -> None:
    """Draw MACHINE (a folder of models/) with its tooth in mid-cut into a PNG file."""
    answer = Answer(None, quiet)
    if Path(output).suffix.lower() != ".png":
        raise InputProblem(output, "is no name of a PNG picture", "give one that ends in .png")
    check_place(output)
    from testbed.view import render_rig

    try:
        path = render_rig(output, machine, width, height, camera)
    except RuntimeError as problem:
        raise InputProblem(output, f"this computer draws nothing ({problem})", "install an OpenGL driver") from None
    answer.say(f"written: {path}")
