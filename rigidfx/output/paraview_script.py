"""Shows a run in ParaView: its deformed shape, rigid cells dark, flexible ones light; stresses.

A recorder leaves a copy of this file beside fields.pvd; only ParaView's own Python can run it.

    pvbatch view.py                      the last state, as view_rigid.png and view_von_mises.png
    pvbatch view.py --times 0 4.5 9      these times, as view_rigid.0000.png, ...
    pvbatch view.py --film               every time, and films of them: view_rigid.avi, ...
    pvbatch view.py --colour velocity    coloured by another field
    pvbatch view.py --help               all colours, size, direction of the view, ...

Without a display: xvfb-run -a pvbatch view.py. In ParaView's window: Tools, Python Shell, Run
Script, or as a macro, or paraview --script=view.py. It can be run while the simulation goes on.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from math import floor, log10
from pathlib import Path
from typing import Any

__all__ = ["MADE_IN", "main", "write"]

MADE_IN = ""  # the folder that a copy was made for; some versions do not tell a script its place

LIGHT, MIDDLE, DARK = (  # of flexible, reduced and rigid cells
    tuple(share / 255 for share in bytes.fromhex(own)) for own in ("e8e4da", "c98b4b", "33475b")
)
EDGES = (0.3, 0.3, 0.3)
ON_CELLS = ("rigid", "cell_von_mises", "body", "level", "strain_rate", "material")
ON_POINTS = ("displacement", "velocity", "von_mises", "contact_pressure", "gap")
FLAGS = {
    "rigid": "cells",
    "level": "cells",
    "body": "number of the body",
    "material": "number of the material",
}
SCALES = {  # titles and units
    "von_mises": ("von Mises stress at nodes", "Pa"),
    "cell_von_mises": ("von Mises stress, mean of each cell", "Pa"),
    "strain_rate": ("strain rate", "1/s"),
    "displacement": ("displacement", "m"),
    "velocity": ("velocity", "m/s"),
    "contact_pressure": ("pressure of contacts", "Pa"),
    "gap": ("gap of contacts", "m"),
}
VECTORS, LOGARITHMIC = ("displacement", "velocity"), ("strain_rate",)
DECADES = 6  # that a logarithmic scale shows at most
PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
FILMS = (  # encoders among VTK's modules; a ParaView may lack each of them
    ("vtkIOFFMPEG", "vtkFFMPEGWriter", ".avi"),
    ("vtkIOOggTheora", "vtkOggTheoraWriter", ".ogv"),
)


def main(folder: Path, arguments: Sequence[str] | None, interactive: bool) -> None:
    """Show the series in a folder.

    Args:
        folder: Where fields.pvd is.
        arguments: Options, see --help; those of the command line if None.
        interactive: Whether a window shows it, so that no pictures are saved.
    """
    options = _options(arguments)
    found = [file for kind in ("pvd", "vtkhdf") if (file := folder / f"fields.{kind}").exists()]
    if not found:
        raise SystemExit(f"No fields in {folder}: keep this script beside the fields of its run.")
    from paraview import simple as pv

    reader = pv.OpenDataFile(str(found[0]))
    pv.RenameSource("fields", reader)
    reader.UpdatePipeline()
    times = list(reader.TimestepValues) or [0.0]
    view = pv.GetActiveViewOrCreate("RenderView")
    body = _draw(pv, view, reader, options)
    scene = pv.GetAnimationScene()
    scene.UpdateAnimationUsingDataTimeSteps()
    if options.film:
        wanted = times
    elif options.times:
        wanted = [min(times, key=lambda have: abs(have - t)) for t in options.times]
    else:
        wanted = times[-1:]
    size = _diagonal(reader)
    out = options.out or folder
    if not interactive:
        out.mkdir(parents=True, exist_ok=True)
        view.ViewSize = list(options.size)  # letters are scaled with a picture that is larger
    colours = _colours(reader, options)
    for colour in colours[:1] if interactive else colours:
        shown, bar = _coloured(pv, view, body, colour, times, options)
        pictures = []
        for k, t in enumerate(wanted):
            scene.AnimationTime = t
            view.ViewTime = t
            body.UpdatePipeline(t)
            shown.UpdatePipeline(t)
            _aim(view, body, size, options)
            pv.Render(view)
            if not interactive:
                number = f".{k:04d}" if len(wanted) > 1 else ""
                pictures.append(out / f"view_{colour}{number}.png")
                pv.SaveScreenshot(str(pictures[-1]), view, ImageResolution=list(options.size))
        if options.film and not interactive:
            _film(out / f"view_{colour}", pictures, options.rate)
        if not interactive:
            bar.Visibility = 0
            pv.Hide(shown, view)


def write(folder: Path) -> None:
    """Leave a copy in the folder of a run.

    Args:
        folder: Where fields.pvd is.

    Raises:
        OSError: If it cannot be written.
    """
    text = Path(__file__).read_text(encoding="utf-8")
    made = text.replace('MADE_IN = ""', f"MADE_IN = {str(folder.resolve())!r}", 1)
    (folder / "view.py").write_text(made, encoding="utf-8")


def _options(arguments: Sequence[str] | None) -> Any:
    parser = argparse.ArgumentParser(
        description="Pictures of a run: deformed; rigid cells dark, flexible ones light; stresses."
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--film", action="store_true", help="pictures of every time, and a film")
    which.add_argument(
        "--times", type=float, nargs="+", metavar="T", help="pictures of the nearest times [s]"
    )
    parser.add_argument(
        "--colour",
        nargs="+",
        choices=(*ON_CELLS, *ON_POINTS),
        help="fields that colour the cells, for a picture each (rigid, if there may be bodies, or "
        "displacement; and von_mises)",
    )
    parser.add_argument("--rate", type=int, default=12, help="pictures per second of a film (12)")
    parser.add_argument("--scale", type=float, default=1.0, help="factor of displacements (1)")
    parser.add_argument(
        "--view",
        type=float,
        nargs=3,
        default=(1.0, -1.6, 0.8),
        metavar=("X", "Y", "Z"),
        help="direction from the body to the camera (1 -1.6 0.8)",
    )
    parser.add_argument(
        "--size", type=int, nargs=2, default=(1280, 800), metavar=("W", "H"), help="pixels"
    )
    parser.add_argument("--no-edges", action="store_true", help="leave out edges of cells")
    parser.add_argument("--out", type=Path, help="folder for the pictures (that of this script)")
    return parser.parse_args(arguments)


def _draw(pv: Any, view: Any, reader: Any, options: Any) -> Any:
    """The deformed body; and the time, and how large displacements are drawn."""
    body = pv.WarpByVector(Input=reader)
    body.Vectors = ["POINTS", "displacement"]
    body.ScaleFactor = options.scale
    pv.RenameSource("deformed", body)
    pv.Hide(reader, view)
    clock = pv.AnnotateTimeFilter(Input=reader)
    scale = "to scale" if options.scale == 1 else f"times {options.scale:g}"
    clock.Format = "t = {time:.4g} s, displacements " + scale
    text = pv.Show(clock, view)
    text.Color = [0.0, 0.0, 0.0]
    view.UseColorPaletteForBackground = 0
    view.Background = [1.0, 1.0, 1.0]
    pv.SetActiveSource(body)
    return body


def _show(pv: Any, view: Any, source: Any, options: Any) -> Any:
    """How a source is shown."""
    shown = pv.Show(source, view)
    shown.Representation = "Surface" if options.no_edges else "Surface With Edges"
    shown.EdgeColor = list(EDGES)
    shown.Ambient, shown.Diffuse, shown.Specular = 0.45, 0.6, 0.0  # near the colours of the legend
    return shown


def _colours(reader: Any, options: Any) -> list[str]:
    """The fields asked for, all there, or those that are shown by default."""
    present = [array.Name for array in (*reader.CellData, *reader.PointData)]
    if not options.colour:
        first = "rigid" if "rigid" in present else "displacement"
        return [first, *(c for c in ("von_mises",) if c in present)]
    for colour in options.colour:
        if colour not in present:
            raise SystemExit(f"This run has no field '{colour}'; it has {', '.join(present)}.")
    return list(options.colour)


def _coloured(
    pv: Any, view: Any, body: Any, colour: str, times: Sequence[float], options: Any
) -> tuple[Any, Any]:
    """Show the body coloured by a field, alike at all times; returns its display and the key."""
    where = "CELLS" if colour in ON_CELLS else "POINTS"
    name, title, source, ends = colour, FLAGS.get(colour, colour), body, None
    if colour == "rigid":
        name = "level"  # which tells reduced parts, too
    if colour in SCALES:
        bottom, top = _ends(body, where, colour, times)
        factor, unit = _prefixed(SCALES[colour][1], max(abs(bottom), abs(top)))
        name = title = f"{SCALES[colour][0]} ({unit})"
        source, ends = pv.Calculator(Input=body), (bottom * factor, top * factor)
        source.AttributeType = "Cell Data" if where == "CELLS" else "Point Data"
        value = f"mag({colour})" if colour in VECTORS else colour
        source.Function, source.ResultArrayName = f"{factor:g}*{value}", name
        source.ReplaceInvalidResults = 0  # contacts have values on their surfaces only
        pv.Hide(body, view)
    shown = _show(pv, view, source, options)
    pv.ColorBy(shown, (where, name))
    table = pv.GetColorTransferFunction(name)
    if name == "level":
        table.InterpretValuesAsCategories = 1
        table.Annotations = ["0", "flexible", "1", "reduced", "2", "rigid"]
        table.IndexedColors = [*LIGHT, *MIDDLE, *DARK]
    else:
        table.ApplyPreset("Viridis (matplotlib)", True)
        table.NanColor = LIGHT
        if ends is None:
            shown.RescaleTransferFunctionToDataRangeOverTime()
        else:
            table.RescaleTransferFunction(*ends)
    if colour in LOGARITHMIC:
        table.MapControlPointsToLogSpace()
        table.UseLogScale = 1
    shown.SetScalarBarVisibility(view, True)
    bar = pv.GetScalarBar(table, view)
    bar.Title, bar.ComponentTitle = title, ""
    bar.TitleColor = bar.LabelColor = [0.0, 0.0, 0.0]
    bar.WindowLocation, bar.Position, bar.ScalarBarLength = "Any Location", [0.88, 0.25], 0.5
    bar.RangeLabelFormat = "%.3g" if pv.GetParaViewVersion().major < 6 else "{:.3g}"
    return source, bar


def _ends(body: Any, where: str, colour: str, times: Sequence[float]) -> tuple[float, float]:
    """The ends of a field's scale over all times; of a logarithmic one above zero."""
    from paraview import servermanager
    from vtkmodules.util.numpy_support import vtk_to_numpy

    found = []
    for t in times:
        body.UpdatePipeline(t)
        data = servermanager.Fetch(body)
        values = data.GetCellData() if where == "CELLS" else data.GetPointData()
        own = vtk_to_numpy(values.GetArray(colour))
        if colour in VECTORS:
            own = (own**2).sum(axis=1) ** 0.5
        own = own[own > 0] if colour in LOGARITHMIC else own[own == own]
        if own.size:
            found.append((float(own.min()), float(own.max())))
    bottom = min((low for low, _ in found), default=0.0)
    top = max((high for _, high in found), default=1.0)
    if colour in LOGARITHMIC:
        return max(min(bottom, top / 100) or top / 100, top * 10.0**-DECADES), top
    return (bottom, top) if bottom < 0 else (0.0, top or 1.0)


def _prefixed(unit: str, largest: float) -> tuple[float, str]:
    """The factor to a unit with a prefix, and its name: as in `rigidfx.plot.units`."""
    if unit[0].isdigit() or not 0 < largest < float("inf"):
        return 1.0, unit
    power = min(max(3 * floor(log10(largest) / 3 + 1e-12), -12), 12)
    return 10.0**-power, PREFIXES[power] + unit


def _film(path: Path, pictures: Sequence[Path], rate: int) -> None:
    """Join pictures to a film, if this ParaView can."""
    for module, name, suffix in FILMS:
        try:
            writer = getattr(import_module(f"vtkmodules.{module}"), name)()
        except (ImportError, AttributeError):
            continue
        from vtkmodules.vtkIOImage import vtkPNGReader

        picture = vtkPNGReader()
        writer.SetInputConnection(picture.GetOutputPort())
        writer.SetFileName(str(path.with_suffix(suffix)))
        writer.SetRate(rate)
        for k, file in enumerate(pictures):
            picture.SetFileName(str(file))
            picture.Update()
            if k == 0:
                writer.Start()
            writer.Write()
        writer.End()
        for file in pictures:  # the film has them
            file.unlink()
        return
    sys.stderr.write(
        "This ParaView cannot encode films. ffmpeg can join the pictures: "
        f"ffmpeg -i {path}.%04d.png -pix_fmt yuv420p {path}.mp4\n"
    )


def _diagonal(source: Any) -> float:
    """Diagonal of a box round a source [m]."""
    b = source.GetDataInformation().GetBounds()
    return float(sum((b[2 * i + 1] - b[2 * i]) ** 2 for i in range(3)) ** 0.5)


def _aim(view: Any, body: Any, size: float, options: Any) -> None:
    """Follow the body, so that it has the same size in all pictures."""
    b = body.GetDataInformation().GetBounds()
    middle = [(b[2 * i] + b[2 * i + 1]) / 2 for i in range(3)]
    length = sum(x * x for x in options.view) ** 0.5
    upright = abs(options.view[2]) < 0.99 * length
    view.CameraParallelProjection = 1
    view.CameraFocalPoint = middle
    view.CameraPosition = [
        m + 4 * size * x / length for m, x in zip(middle, options.view, strict=True)
    ]
    view.CameraViewUp = [0.0, 0.0, 1.0] if upright else [0.0, 1.0, 0.0]
    view.CameraParallelScale = 0.52 * size


if __name__ == "__main__":
    # pvbatch and pvpython name the script; ParaView's window does not, nor always its place.
    batch = bool(sys.argv and sys.argv[0])
    here = Path(__file__).resolve().parent if "__file__" in globals() else Path(MADE_IN)
    main(here, None if batch else [], not batch)
