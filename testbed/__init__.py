"""Virtual machining testbed: simulate a flexible workpiece being milled, and learn what a model of it lacks."""

from pathlib import Path

if not (Path(__file__).parent / "analysis").is_dir():  # a source tree, where these stand beside: a wheel holds them inside
    __path__.append(str(Path(__file__).parents[1]))
