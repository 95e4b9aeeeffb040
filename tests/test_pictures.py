"""The standard pictures of a run, in one call, from what its recorder has left."""

import operator
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from parallel import report as tell
from parallel import run as mpirun

import rigidfx as rf
from rigidfx.output.history import columns_of
from rigidfx.plot import joints
from rigidfx.plot.curves import figure_of
from rigidfx.plot.panels import MOST, of_joints
from rigidfx.plot.pictures import pictures
from rigidfx.plot.renders import Look, Photograph, images, key, pyvista, surface_of
from rigidfx.plot.shapes import Shapes, factor_of, show

pytest.importorskip("pyvista")
pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself")

MATERIAL = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)


def run(folder, rigid=False, stress=True, order=1):
    """Five steps of a turning bar, a third of which becomes rigid."""
    bar = rf.box((0, 0, 0), (3, 1, 1), (3, 1, 1))
    bar = bar.with_cells("soft", lambda x: x[0] > 1 - 1e-9)
    spin = rf.InitialVelocity(angular=(0.2, 1.0, 0.1))
    scene = rf.Scene(bar, MATERIAL, [spin], order=order, probes={"end": (3, 1, 1)})
    criterion = rf.StrainRate(1e9, 0.2, never="soft", min_cells=1, wake="none") if rigid else None
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
    names = ["histories.png", "probes.png", "unknowns.png"]
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
    look = Look((0, -1, 0), (0, 0, 1), False)
    (image,) = images([photograph(1e-6, 1e-3, 1.0)], "strain_rate", look, 99)
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


def test_joints_over_time(tmp_path):
    """Angles, travels, efforts and forces: the same from reports and from files."""
    bars = rf.box((0, 0, 0), (3, 1, 1), (3, 1, 1)).with_cells("bar", lambda x: x[0] < 1.01)
    bars = bars.with_cells("slider", lambda x: x[0] > 1.99)
    pin = rf.Revolute("ground", "bar", (0, 0.5, 0.5), (0, 1, 0), name="pin_a")
    guide = rf.Prismatic("ground", "slider", (3, 0, 0), (1, 0, 0), name="guide")
    acting = [rf.Motor("pin_a", torque=3.0), rf.Stop("guide", high=1e-5, stiffness=1e5)]
    acting += [rf.Motor("guide", force=30.0), rf.Rigid("bar"), rf.Rigid("slider")]
    scene = rf.Scene(bars, MATERIAL, [pin, guide, *acting])
    assert re.search(r"\n  Motor +of 'pin_a' +torque 3 ", scene.describe())
    assert "Motor 'guide'" in scene.describe()
    reports = []
    with rf.Recorder(scene, tmp_path, every=9) as recorder:
        for report in rf.simulate(scene, 0.01, 0.06, progress=False):
            recorder.write(report)
            reports.append(report)
    found = of_joints(columns_of(tmp_path))
    (angle,), unit = found["Angles of joints"]
    assert (angle.label, unit) == ("pin_a", "angle (rad)")
    np.testing.assert_allclose(angle.y[1:], [r.joints["pin_a"].angle for r in reports[1:]])
    (torque,), unit = found["Torques of motors, springs and stops"]
    assert (torque.label, unit) == ("motor of pin_a", "torque (N m)")
    np.testing.assert_allclose(torque.y[1:], 3.0)
    forces, _ = found["Forces of motors, springs and stops"]
    assert {curve.label for curve in forces} == {"motor of guide", "stop of guide"}
    stop = next(curve for curve in forces if "stop" in curve.label)
    assert min(stop.y[1:]) < 0
    assert pictures(tmp_path, frames=0)[1].name == "joints.png"
    for source, name in ((reports, "1.png"), (tmp_path, "2.png"), (columns_of(tmp_path), "3.png")):
        joints(source, tmp_path / name)
        assert (tmp_path / name).read_bytes() == (tmp_path / "joints.png").read_bytes()
    with pytest.raises(rf.OutputError, match="there are no joints"):
        joints(reports[:1], tmp_path / "none.png")
    with pytest.raises(rf.SceneError, match="a list of reports"):
        joints([1.0], tmp_path / "none.png")


def test_of_many_joints_the_largest_are_drawn():
    """What is left out is said."""
    h = {"t": np.arange(2.0)}
    for k in range(MOST + 2):
        h |= {f"joint_{k}_{name}": np.full(2, k + 1.0) for name in ("gap", "angle", "travel")}
        h |= {f"joint_{k}_force_{axis}": np.ones(2) for axis in "xyz"}
    ((heading, (lines, _)),) = [p for p in of_joints(h).items() if p[0].startswith("Angles")]
    assert heading == f"Angles of joints, the largest {MOST} of {MOST + 2}"
    assert [curve.label for curve in lines] == [str(k) for k in range(MOST + 1, 1, -1)]


def test_displacements_are_enlarged_by_themselves(tmp_path, monkeypatch):
    """By 1, 2 or 5 times a power of ten, never made smaller; told on the picture."""
    line = np.array([[0.0, 0, 0], [3, 4, 0]])  # 5 m; the largest is drawn as half a metre at most
    for u, factor in ((2e-4, 2000.0), (0.06, 5.0), (0.4, 1.0), (7.0, 1.0), (0.0, 1.0)):
        assert factor_of("auto", line, [0 * line, np.array([[0, 0, u], [0, 0, 0]])]) == factor
    assert factor_of(3.0, line, []) == 3.0
    told = []
    monkeypatch.setattr("rigidfx.plot.renders.tell_scale", lambda f, s, p: told.append(s))
    bar = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    scene = rf.Scene(bar, MATERIAL, [rf.Fixed("x0"), rf.Traction("x1", (0, 0, 0.01))])
    shapes = Shapes(scene, [1.0], colour="von_mises")
    with rf.Recorder(scene, tmp_path, every=1) as recorder:
        for report in rf.static(scene, 2, verbose=False):
            recorder.write(report)
            shapes.add(report)
            shapes.keep(report, "largest")
    assert shapes.count == 2
    shapes.draw(tmp_path / "auto.png", scale="auto")
    assert told[0] > 1
    pictures(tmp_path, frames=2, scale="auto")
    assert told == [told[0]] * 4, "shapes, stress, film"


def test_a_terminal_sees_what_is_drawn(tmp_path, monkeypatch, capsys):
    """A bar for each picture of shapes, which is gone at its end."""
    run(tmp_path, stress=False)
    pictures(tmp_path, frames=2)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    pictures(tmp_path, frames=2)
    told = capsys.readouterr().err
    for words in ("reading fields", "drawing shapes.png", "drawing film.gif"):
        assert words in told
    assert "\n" not in told


def test_command_line(tmp_path, monkeypatch, capsys):
    run(tmp_path)
    command = ["rigidfx.plot", str(tmp_path), "--frames", "2", "--view", "0", "-1", "0.2"]
    command += ["--scale", "auto"]
    monkeypatch.setattr(sys, "argv", command)
    monkeypatch.delitem(sys.modules, "rigidfx.plot.__main__", raising=False)
    runpy.run_module("rigidfx.plot", run_name="__main__")
    assert frames(tmp_path / "film.gif") == 2
    assert f"{tmp_path / 'film.gif'}\n" in capsys.readouterr().out
    for more, words in (
        ([str(tmp_path / "none")], "could not be drawn: there is no "),
        ([str(tmp_path), "--scale", "much"], "--scale: must be a number or auto, got 'much'"),
        ([str(tmp_path), "--view", "0", "0", "1"], "view and up are parallel"),
    ):
        monkeypatch.setattr(sys, "argv", ["rigidfx.plot", *more])
        monkeypatch.delitem(sys.modules, "rigidfx.plot.__main__", raising=False)
        with pytest.raises(SystemExit):
            runpy.run_module("rigidfx.plot", run_name="__main__")
        assert words in capsys.readouterr().err


def test_folder_without_a_run(tmp_path):
    with pytest.raises(rf.OutputError, match=r"history\.csv"):
        pictures(tmp_path)


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
