"""What mkdocs does not know: what stands beside docs/, and the gallery, which is written from the effects' own files."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]  # mkdocs looks for neither

from draw import effect_picture  # noqa: E402

from testbed.catalogue import catalogue  # noqa: E402

BESIDE = ("VALIDATION.md", "DECISIONS.md", "SECURITY.md", "CHANGELOG.md", "CONTRIBUTING.md", "benchmarks/RESULTS.md",
          "benchmarks/DIAGNOSE.md", "models/flexure/rig.png")
_LINK = re.compile(r"\]\((?!https?://|mailto:|#)([^)#\s]+)(#[^)\s]+)?\)")


def on_files(files: Any, config: Any) -> Any:
    """The pages beside docs/ and the gallery join those that mkdocs found."""
    for name in BESIDE:
        if (ROOT / name).is_file():
            files.append(File.generated(config, Path(name).name, abs_src_path=str(ROOT / name)))
    page, pictures = gallery()
    files.append(File.generated(config, "gallery.md", content=page))
    for name, picture in pictures.items():
        files.append(File.generated(config, f"gallery/{name}.svg", content=picture))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Links between docs/ and the pages beside it lead to where those stand in the site."""
    source = page.file.abs_src_path
    if source is None:
        return markdown
    return _LINK.sub(lambda link: f"]({_in_site(Path(source).parent, link[1], page)}{link[2] or ''})", markdown)


def _in_site(folder: Path, link: str, page: Any) -> str:
    """A link to a file of the repository as a link of the site, from the page's own place there."""
    target = (folder / link).resolve()
    up = "../" * (len(Path(page.file.src_uri).parts) - 1)
    if target.is_relative_to(ROOT / "docs"):
        return up + target.relative_to(ROOT / "docs").as_posix()
    if target.is_relative_to(ROOT) and target.relative_to(ROOT).as_posix() in BESIDE:
        return up + target.name
    return link  # mkdocs complains of it


def gallery() -> tuple[str, dict[str, str]]:
    """A page of all effects (law, source, validity, what they leave, what they are confused with), and their pictures."""
    effects, pictures = catalogue(), {}
    parts = ["# Gallery of effects", "An effect is a law that a model may have or lack. This page is written from the files "
             "of `testbed/effects/`. Each picture is a simulation: one test cut with the effect at its example values, and "
             "what the effect changes in it. Add your own: [adding an effect](adding.md#an-effect)."]
    parts.append("\n".join(f"- [{one.title}](#{name.replace('_', '-')}) `{name}`" for name, one in effects.items()))
    for name, one in effects.items():
        pictures[name], story = effect_picture(one)
        rows = [f"| `{each.name}` | {each.symbol} | {each.unit} | {each.bounds[0]:g} to {each.bounds[1]:g} | {each.meaning} |"
                for each in one.every_parameter]
        others = [f"- *{effects[other].title}* (`{other}`): {test}" if other in effects else f"- `{other}`: {test}"
                  for other, test in one.confused_with]
        parts += [f"## {one.title} {{ #{name.replace('_', '-')} }}", f"`{name}`", f"**Law.** `{one.law}`",
                  f"**Source.** {one.source}", f"**Valid.** {one.validity}", f"**Leaves in a measurement.** {one.leaves}"]
        if rows:
            parts.append("\n".join(["| parameter | symbol | unit | from, to | what it is |", "|---|---|---|---|---|", *rows]))
        if others:
            parts.append("**Confused with**, and the test that separates them:\n\n" + "\n".join(others))
        parts.append(f"![{one.title}: {story}, with the effect and its change](gallery/{name}.svg)")
    return "\n\n".join(parts) + "\n", pictures
