"""Shows a run in ParaView, deformed: flexible cells light, reduced ones brown, rigid ones dark.

pvbatch view.py [FIELD] [--film]     the last state, or all times, in pictures beside this file
"""

import sys
from pathlib import Path

from paraview import simple as pv

FIELDS = ""  # the folder of the run

reader = pv.OpenDataFile(str(min(Path(FIELDS).glob("fields.[pv]*"))))
reader.UpdatePipeline()
cells, nodes = ([array.Name for array in data] for data in (reader.CellData, reader.PointData))
default = "level" if "level" in cells else "displacement"
field = next((word for word in sys.argv[1:] if word in [*cells, *nodes]), default)

deformed = pv.WarpByVector(Input=reader, Vectors=["POINTS", "displacement"])
view = pv.GetActiveViewOrCreate("RenderView")
shown = pv.Show(deformed, view)
shown.Representation = "Surface With Edges"
pv.ColorBy(shown, ("CELLS" if field in cells else "POINTS", field))
colours = pv.GetColorTransferFunction(field)
if field == "level":
    colours.InterpretValuesAsCategories = 1
    colours.Annotations = ["0", "flexible", "1", "reduced", "2", "rigid"]
    colours.IndexedColors = [0.91, 0.89, 0.85, 0.79, 0.55, 0.29, 0.2, 0.28, 0.36]
else:
    shown.RescaleTransferFunctionToDataRangeOverTime()
shown.SetScalarBarVisibility(view, True)
pv.Show(pv.AnnotateTimeFilter(Input=reader, Format="t = {time:.4g} s"), view)

pv.GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
pv.GetAnimationScene().GoToLast()
view.CameraPosition, view.CameraFocalPoint, view.CameraViewUp = [1, -1.6, 0.8], [0, 0, 0], [0, 0, 1]
pv.ResetCamera(view)
save = pv.SaveAnimation if "--film" in sys.argv else pv.SaveScreenshot
save(f"{FIELDS}/view_{field}.png", view, ImageResolution=[1280, 800])
