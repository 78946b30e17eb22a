"""``brdfcheck render``: pictures of presets and of scenes."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from brdfcheck.cli.app import Debug, ExitCode, Task, app, refuse_outputs, start
from brdfcheck.cli.output import Output
from brdfcheck.messages import UsageError, one_line

_SUFFIXES = (".png", ".exr")
_MOST = 8192  # samples along a side


@app.command(
    "render",
    epilog="""\b
Examples:
  brdfcheck render --list
  brdfcheck render furnace -o furnace.png
  brdfcheck render figure-9 --size 512 --quality high -o figure-9.exr
  brdfcheck render scene.toml --bits 16 -o scene.png

\b
scene.toml:
  size = [512, 512]                 # height, width; one number is a square
  background = 0.1                  # a number or RGB, linear
  [geometry]                        # sphere (center, radius) or a mesh: icosphere (level),
  kind = "icosphere"                # latitude-longitude (rows, columns), zigzag, corrugated,
                                    # or mesh, of a file beside the scene's (file = "bunny.ply")
  level = 3
  shading = "phong"                 # of a mesh: flat, gouraud, phong; weighting, interpolation
  [camera]
  kind = "perspective"              # or orthographic (half_height)
  eye = [0, 1, 5]
  field_of_view = 25
  [material]
  kind = "surface"                  # or highlight, translucent, metal
  terms = [{ brdf = "lambert", tint = [0.6, 0.2, 0.1] }, { brdf = "phong", tint = 0.2, n = 50 }]
  [[lights]]                        # ambient, environment, distant, point, spot, polygon
  kind = "point"
  position = [2, 2, 3]
  intensity = 30
  quadratic_attenuation = 1

\b
Only material and lights are needed. The keys are the parameters of the classes in brdfcheck.scene.
The tables of brdfcheck budget may be there too: a [room] is rendered.
A colour may be a spectrum: { wavelengths = [400, 700], reflectance = [0.2, 0.8] } in nm.
A BRDF that is not validated is refused, unless the scene says allow_unvalidated = true.""",
)
def _render(
    what: Annotated[
        str | None, typer.Argument(metavar="PRESET|SCENE.toml", help="A preset's name or a scene's file.", show_default=False)
    ] = None,
    output: Annotated[
        str | None, typer.Option("-o", "--output", metavar="FILE", help="Ends in .png (sRGB) or .exr (linear).")
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(metavar="PIXELS", help="Side of each square of a preset, or HEIGHTxWIDTH of a scene. [default: its own]"),
    ] = None,
    quality: Annotated[
        str, typer.Option(metavar="draft|normal|high", help="1, 2 or 4 samples along each side of a pixel.")
    ] = "normal",
    bits: Annotated[str, typer.Option(metavar="8|16", help="Bits of a PNG.")] = "8",
    listing: Annotated[bool, typer.Option("--list", help="List the presets.")] = False,
    debug: Debug = False,
) -> Task:
    """Render a preset or a scene to a file."""
    return Task(lambda: _list() if listing else _run(what, output, size, quality, bits), debug)


def _list() -> int:
    from brdfcheck.scene.presets import PRESETS

    output = Output(None)
    width = max(map(len, PRESETS))
    for name, preset in PRESETS.items():
        output.line(f"{name:<{width}}  {preset.side:4d}  {preset.caption}")
    return ExitCode.PASSED


def _run(what: str | None, target: str | None, size: str | None, quality: str, bits: str) -> int:
    if what is None:
        raise UsageError("say what to render: a preset's name (brdfcheck render --list) or a scene's file")
    if target is None:
        raise UsageError("-o: say where the picture goes, as in -o picture.png")
    if Path(target).suffix.lower() not in _SUFFIXES:
        raise UsageError(f"--output: the file must end in .png or .exr; got {one_line(target)!r}")
    if bits not in ("8", "16"):
        raise UsageError(f"--bits: must be 8 or 16; got {one_line(bits)!r}")
    refuse_outputs({"--output": target})
    from brdfcheck.scene.canvas import QUALITIES, averaged
    from brdfcheck.scene.presets import named, render_preset

    if quality not in QUALITIES:
        raise UsageError(f"--quality: must be one of {', '.join(QUALITIES)}; got {one_line(quality)!r}")
    is_scene = what.lower().endswith(".toml")
    samples = QUALITIES[quality]
    pixels = None if size is None else _size(size, _MOST // samples, square=not is_scene)
    output = Output(None)
    start()
    from brdfcheck.scene.images import write_image

    began = time.perf_counter()
    if is_scene:
        from brdfcheck.budgets.measure import full_model
        from brdfcheck.budgets.scenes import OWN, parse_scene
        from brdfcheck.documents import read_document
        from brdfcheck.scene import files

        document, label = read_document(what)
        scene = files.parse_scene(document, label, others=OWN)
        height, width = pixels or scene.size
        if max(height, width) * samples > _MOST:
            raise UsageError(f"{one_line(what)}: size must be at most {_MOST // samples} pixels at --quality {quality}")
        full = (height * samples, width * samples)
        try:
            # In a room the light's bounces between its walls come in, which is what a budget's full model has.
            image = full_model(parse_scene(document, label), full) if "room" in document else scene.render(full)
            image = averaged(image, samples)
        except ValueError as error:  # what is right by itself and wrong together, as a camera inside the object
            raise UsageError(f"{one_line(what)}: {one_line(error)}") from None
    else:
        try:
            named(what)
        except KeyError as error:
            raise UsageError(one_line(error.args[0])) from None
        text = f"rendering {what}: {{}} pictures done; the first time, programs are compiled for them"
        with output.waiting(text.format(0)) as show:
            image = render_preset(what, None if pixels is None else pixels[0], quality, lambda count: show(text.format(count)))
    seconds = time.perf_counter() - began
    try:
        write_image(target, image, bits=int(bits), metadata={"rendered": what, "quality": quality})
    except OSError as error:
        raise UsageError(f"--output: cannot write {target!r}: {error.strerror or one_line(error)}") from None
    output.line(f"wrote {target}: {image.shape[1]} x {image.shape[2]} pixels (height x width) in {seconds:.1f} s")
    return ExitCode.PASSED


def _size(text: str, most: int, *, square: bool) -> tuple[int, int]:
    """Height and width from "512" or, for a scene, "384x512"."""
    parts = text.lower().split("x")
    if len(parts) in ((1,) if square else (1, 2)) and all(part.isascii() and part.isdigit() for part in parts):
        height, width = int(parts[0][:9]), int(parts[-1][:9])
        if min(height, width) >= 1 and max(height, width) <= most:
            return height, width
    wanted = "a number of pixels" if square else "a number of pixels or HEIGHTxWIDTH"
    raise UsageError(f"--size: must be {wanted} from 1 to {most}; got {one_line(text)!r}")
