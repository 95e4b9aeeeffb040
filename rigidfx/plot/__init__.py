"""Pictures of runs.

    from rigidfx.plot import pictures
    pictures("out/bar")

    python3 -m rigidfx.plot out/bar

`pictures` makes the standard ones from the files of a `Recorder`; `Shapes` collects the deformed
body while a run goes on; `show` shows that of a report in a notebook or a window; `web` writes a
run's motion as one HTML file; `joints` draws angles, travels and forces of joints; `Curve`,
`curves` and `histories` draw numbers of any runs.
"""

from rigidfx.plot.curves import Curve, curves, figure_of, histories, on_first_rank, save
from rigidfx.plot.panels import joints
from rigidfx.plot.pictures import pictures
from rigidfx.plot.shapes import Shapes, show
from rigidfx.plot.web import web

__all__ = [
    "Curve",
    "Shapes",
    "curves",
    "figure_of",
    "histories",
    "joints",
    "on_first_rank",
    "pictures",
    "save",
    "show",
    "web",
]
