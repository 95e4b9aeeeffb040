"""The standard pictures of a run, in one call, from what its recorder has left."""

from __future__ import annotations

import operator
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from parallel import report as tell
from parallel import run as mpirun

import rigidfx as rf
from rigidfx.plot.curves import figure_of
from rigidfx.plot.pictures import pictures
from rigidfx.plot.renders import Photograph, images, key, pyvista, surface_of
from rigidfx.plot.shapes import Shapes
from rigidfx.plot.show import show

pytest.importorskip("pyvista")
pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself")

MATERIAL = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)


def run(folder, rigid=False, stress=True, order=1):
    """Five steps of a turning bar, a third of which becomes rigid."""
    bar = rf.box((0, 0, 0), (3, 1, 1), (3, 1, 1))
    bar = bar.with_cells("soft", lambda x: x[0] > 1 - 1e-9)
    spin = rf.InitialVelocity(angular=(0.2, 1.0, 0.1))
    scene = rf.Scene(bar, MATERIAL, [spin], order=order, probes={"end": (3, 1, 1)})
    criterion = rf.StrainRate(1e9, 0.2, never="soft", min_cells=1, patience=1) if rigid else None
    shapes = Shapes(scene, [0.1, 0.5], colour="von_mises")
    with rf.Recorder(scene, folder, every=1, stress=stress) as recorder:
        for report in rf.simulate(scene, 0.1, 0.5, rigidify=criterion, progress=False):
            recorder.write(report)
            shapes.add(report)
    return shapes


def pixels(path):
    """RGB of a picture, as floats."""
    from matplotlib.image import imread

    return imread(path)[..., :3]


def dark(image):
    """How many pixels have the colour of rigid cells, or its shades."""
    return int(np.count_nonzero((image[..., 2] > image[..., 0] + 0.05) & (image[..., 2] < 0.5)))


def frames(path):
    """Number of pictures in a GIF."""
    from PIL import Image

    with Image.open(path) as film:
        return film.n_frames


def test_pictures_of_a_run_with_bodies(tmp_path):
    run(tmp_path, rigid=True)
    made = pictures(tmp_path, shapes=3, frames=4)
    names = ["histories.png", "probes.png", "unknowns.png", "ledger.png"]
    names += ["shapes.png", "stress.png", "strain_rate.png", "film.gif"]
    assert made == [tmp_path / name for name in names]
    shapes = pixels(tmp_path / "shapes.png")
    thirds = np.array_split(shapes[:, : int(0.85 * shapes.shape[1])], 3, axis=1)
    darkness = [dark(third) for third in thirds]  # t = 0, 0.2 and 0.5 s: flexible, rigid, rigid
    assert darkness[0] == 0
    assert min(darkness[1:]) > 1000
    stress = pixels(tmp_path / "stress.png")
    assert np.ptp(stress, axis=2).max() > 0.5  # coloured
    assert frames(tmp_path / "film.gif") == 4


def test_strain_rates_have_a_logarithmic_scale():
    """Of six powers of ten at most and two at least, whatever is zero in rigid cells."""

    def photograph(*rates):
        cell = pyvista().ImageData(dimensions=(len(rates) + 1, 2, 2)).cast_to_unstructured_grid()
        cell.cell_data["colour"] = np.array(rates, np.float32)
        cell = surface_of(cell, np.zeros((cell.n_points, 3)), "strain_rate", rates)
        return Photograph(0.0, cell)

    for rates, ends in (
        ((0.0, 1e-4, 1.0), (1e-4, 1.0)),
        ((1e-9, 2.0), (2e-6, 2.0)),
        ((3.0,), (0.03, 3.0)),
    ):
        figure, axes = figure_of(1, 1, (3, 3), "")
        shown = [photograph(*rates)]
        key(figure, axes, "strain_rate", shown)
        scale = figure.axes[-1]
        assert scale.get_yscale() == "log"
        np.testing.assert_allclose(scale.get_ylim(), ends, rtol=1e-6)
    (image,) = images(
        [photograph(1e-6, 1e-3, 1.0)], "strain_rate", (0, -1, 0), (0, 0, 1), False, 99
    )
    middle = image[image.shape[0] // 2]
    colours = np.unique(middle[(middle != 255).any(axis=1)], axis=0)
    assert len(colours) >= 3, "a linear scale shows two of them alike"


def test_pictures_of_a_flexible_run_of_second_order(tmp_path):
    shapes = run(tmp_path, stress=False, order=2)
    made = pictures(tmp_path, frames=0)
    assert [path.name for path in made] == ["histories.png", "probes.png", "shapes.png"]
    shapes.draw(tmp_path / "von_mises.png")
    assert np.ptp(pixels(tmp_path / "von_mises.png"), axis=2).max() > 0.5


def test_joints_have_arrows(tmp_path):
    """Red along forces, in proportion, before the body; rounding in moments is none."""
    bars = rf.box((0, 0, 0), (3, 1, 1), (3, 1, 1)).with_cells("bar", lambda x: x[0] > -1)
    pin = rf.Spherical("ground", "bar", (0, 0.5, 0.5), name="pin")
    scene = rf.Scene(bars, MATERIAL, [rf.Rigid("bar"), pin, rf.Gravity((0, 0, -9.81))])
    with rf.Recorder(scene, tmp_path, every=1) as recorder:
        for report in rf.simulate(scene, 0.01, 0.02, progress=False):
            recorder.write(report)
    pictures(tmp_path, frames=0, view=(0, -1, 0))
    shapes = pixels(tmp_path / "shapes.png")
    red = (shapes[..., 0] > 0.6) & (shapes[..., 1] < 0.4)
    blue = (shapes[..., 2] > 0.6) & (shapes[..., 0] < 0.4)
    rows, _ = np.nonzero(red)
    assert np.count_nonzero(red) > 200
    assert np.ptp(rows) > 60, "upwards, a fifth of the body long"
    assert not blue.any()


def test_command_line(tmp_path, monkeypatch):
    run(tmp_path)
    command = ["rigidfx.plot", str(tmp_path), "--frames", "2", "--view", "0", "-1", "0.2"]
    monkeypatch.setattr(sys, "argv", command)
    monkeypatch.delitem(sys.modules, "rigidfx.plot.__main__", raising=False)
    runpy.run_module("rigidfx.plot", run_name="__main__")
    assert frames(tmp_path / "film.gif") == 2


def test_folder_without_a_run(tmp_path):
    with pytest.raises(rf.OutputError, match=r"history\.csv"):
        pictures(tmp_path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("view", (0, 0, 0)), ("view", (1, 0)), ("view", (0, 0, 2)), ("up", (0, 0, np.nan))),
        *(("scale", 0), ("scale", "much")),
        *(("frames", -1), ("frames", 1.5), ("shapes", 0), ("shapes", "8")),
    ],
)
def test_bad_arguments(tmp_path, name, value):
    """Refused before a file is looked for."""
    with pytest.raises(rf.SceneError, match=f"pictures: {name}"):
        pictures(tmp_path, **{name: value})


@pytest.mark.parallel
def test_pictures_on_two_ranks(tmp_path):
    """Files are known on both ranks, and so is that there are none."""
    answers = mpirun(__file__, 2, 120, str(tmp_path / "run"))
    assert answers[0] == answers[1]
    assert [Path(path).name for path in answers[0][0]] == [
        *("histories.png", "probes.png", "shapes.png", "stress.png")
    ]
    assert "history.csv" in answers[0][1]


if __name__ == "__main__":
    run(sys.argv[1])
    made = [str(path) for path in pictures(sys.argv[1], frames=0)]
    try:
        pictures(Path(sys.argv[1]) / "nothing")
    except rf.OutputError as error:
        answers = MPI.COMM_WORLD.gather((made, str(error)))
        if answers is not None:
            tell(answers)


def test_a_notebook_shows_scene_report_and_ledger(monkeypatch):
    """Short lines, tables, and the deformed body by pyvista, coloured and to scale."""
    pv = pytest.importorskip("pyvista")
    bar = rf.box((0, 0, 0), (4, 1, 1), (8, 2, 2))
    effects = [rf.Fixed("x0"), rf.Traction("x1", (0, 0, 2e3))]
    steel = rf.StVenantKirchhoff(E=2e7, nu=0.3, rho=1000.0)
    scene = rf.Scene(bar, steel, effects, probes={"<tip>": (4, 0.5, 0.5)})
    control = rf.StepControl(0.05, "<tip>", largest=0.1)
    *_, last = rf.simulate(scene, control, 0.1, progress=False)
    html = operator.methodcaller("_repr_html_")  # as a notebook asks for it
    assert len(repr(scene)) < 120
    assert len(repr(last)) < 120
    assert f"time {last.ledger.time.relative:.2%}" in repr(last.ledger)
    assert "Traction" in html(scene)
    assert "u of &lt;tip&gt; [m]" in html(last)
    assert str(last.ledger).split("\n")[0] in html(last.ledger)
    drawn = []
    monkeypatch.setattr(pv.Plotter, "show", lambda plotter: drawn.append(plotter))
    for colour in ("displacement", "velocity", "rigid"):
        show(last, colour, scale=10.0)
    titles = [title for plotter in drawn for title in plotter.scalar_bars.keys()]  # noqa: SIM118
    assert titles == ["displacement [m]", "velocity [m/s]", "rigid: 1"]
    highest = drawn[0].mesh.points[:, 2].max()
    assert highest == pytest.approx(1 + 10 * last.probes["<tip>"][2], rel=0.05)
    with pytest.raises(rf.SceneError, match="colour must be one of"):
        show(last, "red")
