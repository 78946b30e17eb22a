"""``brdfcheck render``: pictures of presets and of scenes."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.readers.specs import is_file_spec, split_spec
from brdfcheck.cli import words
from brdfcheck.cli.app import PLAIN, ExitCode, Hold, asked, command, start
from brdfcheck.cli.output import Output, refused
from brdfcheck.messages import UsageError, one_line

Quality = Literal["draft", "normal", "high"]


@command(
    "render",
    epilog="""\b
Examples:
  brdfcheck render --list
  brdfcheck render furnace -o furnace.png
  brdfcheck render sphere --brdf disney.brdf --set roughness=0.3 -o sphere.png
  brdfcheck render furnace --brdf mine.py:glossy --set n=50 -o glossy.png
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
Only material and lights are needed. The keys are the parameters of the classes in
brdfcheck.scene. The tables of brdfcheck budget may be there too: a [room] is rendered.
A term's BRDF may be in a file beside the scene: { brdf = "shader.glsl:shade", n = 20,
reading = { returns = "brdf*cos", args = "N,L,V", defines = { FAST = 0 }, folders = ["inc"] } }.
A colour may be a spectrum: { wavelengths = [400, 700], reflectance = [0.2, 0.8] } in nm.
A BRDF that is not validated is refused, unless the scene says allow_unvalidated = true.""",
)
def _render(
    what: Annotated[
        str | None,
        typer.Argument(
            metavar="PRESET|SCENE.toml",
            help="A preset's name, a scene's file, or with --brdf: sphere or furnace.",
            show_default=False,
        ),
    ] = None,
    brdf: Annotated[
        str | None,
        typer.Option(
            "--brdf", metavar="NAME", help="Show this BRDF: a catalogue name, path/to/file.py:object, or a shader file."
        ),
    ] = None,
    hold: Hold = None,
    how: Reading = PLAIN,
    target: Annotated[
        str | None,
        words.file("-o", "--output", ends=(".png", ".exr"), help="Where the picture goes: .png (sRGB) or .exr (linear)."),
    ] = None,
    size: Annotated[
        words.Size | None,
        typer.Option(
            metavar="SIDE|HEIGHTxWIDTH",
            parser=words.size,
            help="The side of each square of a preset, or the size of a scene. [default: its own]",
        ),
    ] = None,
    quality: Annotated[Quality, typer.Option(help="1, 2 or 4 samples along each side of a pixel.")] = "normal",
    bits: Annotated[Literal["8", "16"] | None, typer.Option(help="Bits of each channel of a .png. [default: 8]")] = None,
    listing: Annotated[bool, typer.Option("--list", help="List the presets, and render nothing.")] = False,
) -> int:
    """Render a preset, a scene, or a BRDF of your own to a file."""
    output = Output()
    held = words.together(hold, option="--set")
    if brdf is None and (held or not how.is_plain):
        what_for = "--set goes" if held else "-D, -I, --args and --returns go"
        raise UsageError(f"{what_for} with --brdf; a scene says it in its file")
    if listing and (what is not None or target is not None or brdf is not None):
        raise UsageError("--list renders nothing: leave out what to render and -o, or leave out --list")
    if listing:
        from brdfcheck.scene.presets import PRESETS

        width = max(map(len, PRESETS))
        for name, preset in PRESETS.items():
            output.line(f"{name:<{width}}  {preset.side:4d}  {preset.caption}")
        return ExitCode.PASSED
    if what is None:
        raise UsageError("say what to render: a preset's name (brdfcheck render --list) or a scene's file")
    if target is None:
        raise UsageError("-o: say where the picture goes, as in -o picture.png")
    if bits is not None and not target.lower().endswith(".png"):
        raise UsageError("--bits goes with a .png; an .exr has 32 bits in each channel")
    from brdfcheck.scene.canvas import QUALITIES

    samples = QUALITIES[quality]
    most = words.MOST_PIXELS // samples
    if size is not None and max(size) > most:
        raise UsageError(f"--size: must be at most {most} pixels at --quality {quality}; got {max(size)}")
    start()
    from brdfcheck.scene.images import tone_mapped, write_image

    began = time.perf_counter()
    if brdf is not None:
        image = _of_brdf(what, brdf, held, how, size, quality, output)
    elif what.lower().endswith(".toml"):
        image = _of_scene(what, size, samples, most, quality)
    else:
        image = _of_preset(what, size, quality, output)
    said = ""
    if brdf is not None and what == "sphere" and target.lower().endswith(".png"):
        image, most = tone_mapped(image)
        if most > 1:
            said = f"; {most:.3g} times as bright as a matt white sphere, so that it is darkened (an .exr has the numbers)"
    seconds = time.perf_counter() - began
    with refused("--output", target):
        metadata = {"rendered": what if brdf is None else f"{what} of {brdf}", "quality": quality}
        write_image(target, image, bits=int(bits or "8"), metadata=metadata)
    output.line(f"wrote {target}: {image.shape[1]} x {image.shape[2]} pixels (height x width) in {seconds:.1f} s{said}")
    return ExitCode.PASSED


def _of_scene(path: str, size: words.Size | None, samples: int, most: int, quality: str) -> Any:
    from brdfcheck.budgets.scenes import OWN, parse_scene
    from brdfcheck.documents import read_document
    from brdfcheck.scene import files
    from brdfcheck.scene.canvas import averaged

    document, label = read_document(path)
    folder = Path(path).parent
    scene = files.parse_scene(document, label, others=OWN, folder=folder)
    height, width = size or scene.size
    if max(height, width) > most:
        raise UsageError(f"{one_line(path)}: size must be at most {most} pixels at --quality {quality}")
    full = (height * samples, width * samples)
    with asked(f"{one_line(path)}: "):  # what is right by itself and wrong together, as a camera inside the object
        # In a room the light's bounces between its walls come in, which is what a budget's full model has.
        if "room" not in document:
            return averaged(scene.render(full), samples)
        from brdfcheck.budgets.measure import full_model

        return averaged(full_model(parse_scene(document, label, folder=folder), full), samples)


def _of_brdf(
    kind: str,
    name: str,
    held: Mapping[str, words.Interval],
    how: Reading,
    size: words.Size | None,
    quality: str,
    output: Output,
) -> Any:
    """A picture of one BRDF. UsageError where it is not known, or cannot be called."""
    from brdfcheck.brdf.family import NoRange
    from brdfcheck.scene.functions import brdf_of
    from brdfcheck.scene.presets import OF_ONE, render_brdf

    if kind not in OF_ONE:
        raise UsageError(f"--brdf goes with {' or '.join(OF_ONE)}; got {one_line(kind)!r}")
    for parameter, (low, high) in held.items():
        if low != high:
            raise UsageError(f"--set {parameter}={low:g}:{high:g}: a picture is of one BRDF; give {parameter} one value")
    side = _side(size) or 256
    values = {parameter: low for parameter, (low, _) in held.items()}
    try:
        with asked(brdf=name):
            shown = brdf_of(name, held, how, furnace=kind == "furnace")
            start()  # a user's file may have changed the precision
            label = ", ".join((name, *(f"{parameter} = {value:g}" for parameter, value in values.items())))
            with output.progress(f"rendering a {kind} of {name}; the first time, programs are compiled for it"):
                return render_brdf(kind, shown, label, side, quality)
    except NoRange as error:
        raise UsageError(f"{error}: {' '.join(f'--set {parameter}=VALUE' for parameter in error.names)}") from None


def _side(size: words.Size | None) -> int | None:
    if size is not None and size.height != size.width:
        raise UsageError(f"--size: a preset is made of squares; give one number of PIXELS, not {size.height}x{size.width}")
    return size and size.height


def _of_preset(name: str, size: words.Size | None, quality: str, output: Output) -> Any:
    from brdfcheck.scene.presets import OF_ONE, PRESETS, named, render_preset

    side = _side(size)
    if name in OF_ONE and name not in PRESETS:
        raise UsageError(f"{name}: say of which BRDF, as in --brdf mine.py:glossy")
    try:
        named(name)
    except KeyError as error:
        from brdfcheck.brdf import catalog

        if name in catalog.names() or (is_file_spec(name) and os.path.isfile(split_spec(name)[0])):
            raise UsageError(f"{name} is no preset: say how to show it, as in render sphere --brdf {name}") from None
        raise UsageError(one_line(error.args[0])) from None
    text = f"rendering {name}: {{}} pictures done; the first time, programs are compiled for them"
    with output.progress(text.format(0)) as progress:
        return render_preset(name, side, quality, lambda count: progress.say(text.format(count)))
