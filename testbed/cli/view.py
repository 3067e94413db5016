"""`testbed view`: a picture of a machine, rendered without a screen, or of a model's cut and modes in the plane."""

from __future__ import annotations

from pathlib import Path

import click

from testbed.api.places import check_place
from testbed.cli._answer import Answer
from testbed.problem import InputProblem


@click.command(short_help="Draw a machine, or a model's angles, forces and modes.",
               epilog="Example: testbed view flexure -o rig.png; testbed view model.yaml -o plane.png")
@click.argument("machine", default="flexure")
@click.option("-o", "--output", default="rig.png", show_default=True, metavar="FILE.png", help="The picture to write.")
@click.option("--camera", default="overview", show_default=True, help="One of those the machine's MuJoCo model names.")
@click.option("--width", type=click.IntRange(16, 8192), default=1600, show_default=True, help="Pixels.")
@click.option("--height", type=click.IntRange(16, 8192), default=1200, show_default=True, help="Pixels.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def command(machine: str, output: str, camera: str, width: int, height: int, quiet: bool) -> None:
    """Draw MACHINE (a folder of models/) with its tooth in mid-cut into a PNG file.

    Of a MODEL.yaml: its cut in the plane, with feed, angles, teeth and forces, and the directions of its modes.
    """
    answer = Answer(None, quiet)
    if Path(output).suffix.lower() != ".png":
        raise InputProblem(output, "is no PNG picture", "give a name that ends in .png")
    check_place(output)
    if Path(machine).suffix.lower() in (".yaml", ".yml"):
        _draw_plane(machine, output, width)
        answer.say(f"written: {output}")
        return
    from testbed.view import render_rig

    try:
        path = render_rig(output, machine, width, height, camera)
    except RuntimeError as problem:
        raise InputProblem(output, f"this computer draws nothing ({problem})", "install an OpenGL driver") from None
    answer.say(f"written: {path}")


def _draw_plane(model_file: str, output: str, width: int) -> None:
    from testbed.analysis.report.plane import plot_plane
    from testbed.api.believed import cutting_model, effects_of

    figure = plot_plane(cutting_model(model_file, effects_of(()).known)[0])
    figure.savefig(output, dpi=width / figure.get_figwidth())
