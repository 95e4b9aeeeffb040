"""What the recorder leaves: read back by VTK and by csv, from one rank and from several."""

import ast
import csv
import os
import resource
import shutil
import signal
import subprocess
import sys
import warnings
import xml.etree.ElementTree as ET
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest
from histories import table
from mpi4py import MPI
from parallel import launch
from parallel import report as tell
from parallel import run as mpirun
from scipy.spatial.transform import Rotation

import rigidfx as rf
from rigidfx.flexible.nodal_stress import material_groups
from rigidfx.flexible.stress import CauchyStress, von_mises
from rigidfx.output.paraview import Body, Series

vtk_xml = pytest.importorskip("vtkmodules.vtkIOXML")
from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: E402

pytestmark = [
    pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself"),
    # A support that begins during the run takes a tenth of the energy.
    pytest.mark.filterwarnings("ignore:.* acts with a jolt"),
]

MATERIAL = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
CELLS = {  # and VTK's numbers of them
    ("hexahedron", 1): 12,
    ("hexahedron", 2): 72,
    ("tetrahedron", 1): 10,
    ("tetrahedron", 2): 71,
}


def make_scene(cell="hexahedron", order=1):
    """A bar whose foot lets go at 0.25 s, pulled at its end."""
    domain = rf.box((0, 0, 0), (1, 1, 3), (2, 2, 5), cell)
    domain = domain.with_cells("low", lambda x: x[2] < 1.21)
    domain = domain.with_cells("high", lambda x: x[2] > 1.19)
    return rf.Scene(
        domain,
        {"low": MATERIAL, "high": rf.StVenantKirchhoff(E=2e4, nu=0.2, rho=20.0)},
        [
            rf.Fixed("z0", until=0.25),
            rf.Fixed("x0", "x", since=0.3),
            rf.Traction("z1", (300.0, 0.0, 100.0)),
        ],
        order=order,
        mass="consistent",
        probes={"tip": (1.0, 1.0, 3.0)},
    )


def record(folder, cell="hexahedron", order=1, **when):
    """Five steps of the bar; the reports and their displacements and velocities by node."""
    scene = make_scene(cell, order)
    body = Body(scene.space, material_groups(scene) if when.get("stress", True) else None)
    reports, fields = [], []
    when = {"every": 1} | when
    with rf.Recorder(scene, folder, **when) as recorder:
        for report in rf.simulate(scene, 0.1, 0.5, progress=False):
            recorder.write(report)
            reports.append(report)
            fields.append([body.on_nodes(f) for f in (report.state.u, report.state.v)])
    return recorder, reports, fields


def read_series(pvd):
    """Times and grids of a series."""
    grids = {}
    for entry in ET.parse(pvd).getroot().iter("DataSet"):
        reader = vtk_xml.vtkXMLUnstructuredGridReader()
        reader.SetFileName(str(pvd.parent / entry.get("file")))
        reader.Update()
        assert reader.GetErrorCode() == 0
        grids[float(entry.get("timestep"))] = reader.GetOutput()
    return grids


def point_data(grid, name):
    return vtk_to_numpy(grid.GetPointData().GetArray(name))


def cell_data(grid, name):
    return vtk_to_numpy(grid.GetCellData().GetArray(name))


def grid_points(grid):
    return vtk_to_numpy(grid.GetPoints().GetData())


@pytest.mark.parametrize(("cell", "order"), CELLS)
def test_series_holds_point_and_cell_data_of_every_time(tmp_path, cell, order):
    recorder, reports, fields = record(tmp_path / "out", cell, order)
    grids = read_series(recorder.series)
    assert list(grids) == [r.t for r in reports]
    for grid, (u, v) in zip(grids.values(), fields, strict=True):
        np.testing.assert_array_equal(point_data(grid, "displacement"), u)
        np.testing.assert_array_equal(point_data(grid, "velocity"), v)
        centres = np.array(
            [np.mean(vtk_to_numpy(grid.GetCell(c).GetPoints().GetData())[:, 2])
             for c in range(grid.GetNumberOfCells())]
        )  # fmt: skip
        np.testing.assert_array_equal(cell_data(grid, "material"), centres > 1.2)
    assert np.abs(fields[-1][0]).max() > 0.01
    assert {grid.GetCellType(c) for c in range(grid.GetNumberOfCells())} == {CELLS[cell, order]}


@pytest.mark.parametrize(("cell", "order"), CELLS)
def test_nodes_of_a_cell_are_in_the_order_of_vtk(tmp_path, cell, order):
    """Shape functions of VTK at its own nodes give back the points of the file."""
    scene = make_scene(cell, order)
    body = Body(scene.space)
    Series(tmp_path / "fields.pvd", body).write(0.0, {"X": body.points}, {})
    (grid,) = read_series(tmp_path / "fields.pvd").values()
    volume = 0.0
    for c in range(grid.GetNumberOfCells()):
        corners = grid.GetCell(c)
        points = vtk_to_numpy(corners.GetPoints().GetData()).copy()
        parametric = np.array(corners.GetParametricCoords()).reshape(-1, 3)
        low, size = points.min(axis=0), np.ptp(points, axis=0)
        volume += size.prod() if cell == "hexahedron" else size.prod() / 6
        if cell == "hexahedron":
            np.testing.assert_allclose(parametric, (points - low) / size, atol=1e-12)
        else:
            a = points[:4]
            affine = a[0] + parametric @ (a[1:] - a[0])
            np.testing.assert_allclose(affine, points, atol=1e-12)
    assert volume == pytest.approx(3.0)


def test_history_has_full_precision_and_a_column_for_everything(tmp_path):
    recorder, reports, _ = record(tmp_path / "a" / "b")
    with recorder.history.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(reports)
    for row, r in zip(rows, reports, strict=True):
        for name in ("step", "t", "dt", "iterations", "cuts", "unknowns", "kinetic", "strain",
                     "springs", "energy", "work_of_loads", "work_of_supports",
                     "momentum_scale"):  # fmt: skip
            assert float(row[name]) == getattr(r, name)
        assert float(row["dissipated"]) == sum(r.dissipated.values())
        vectors = {"L": r.linear_momentum, "J": r.angular_momentum, "u_tip": r.probes["tip"],
                   "impulse": r.impulse, "angular_impulse": r.angular_impulse}  # fmt: skip
        for where in ("z0", "x0"):
            vectors[f"reaction_{where}"] = r.reactions.get(where, np.zeros(3))
            vectors[f"moment_{where}"] = r.reaction_moments.get(where, np.zeros(3))
        for name, vector in vectors.items():
            assert [float(row[f"{name}_{axis}"]) for axis in "xyz"] == list(vector)
    h = rf.read_history(recorder.history)
    assert [name for name in h if not name.endswith("_resolved")] == list(rows[0])
    np.testing.assert_array_equal(h["energy"], [r.energy for r in reports])
    held = (h["t"] <= 0.25) & (h["step"] > 0)
    assert np.all(h["reaction_z0_x"][held] != 0)
    assert np.all(h["reaction_z0_x"][~held] == 0)
    ledger = (
        np.diff(h["energy"]) - (h["work_of_loads"] + h["work_of_supports"] + h["impact_energy"])[1:]
    )
    np.testing.assert_allclose(ledger, 0, atol=1e-10 * h["energy"].max())


@pytest.mark.parametrize(
    ("when", "times"),
    [
        ({"every": 2}, [0.0, 0.2, 0.3, 0.5]),  # 0.25 s, when the foot lets go, is a step as well
        ({"every": 100}, [0.0, 0.5]),
        ({"interval": 0.2}, [0.0, 0.2, 0.4, 0.5]),
        ({"interval": 0.25}, [0.0, 0.25, 0.5]),
        ({"interval": 0.01}, [0.0, 0.1, 0.2, 0.25, 0.3, 0.4, 0.5]),
    ],
)
def test_fields_at_the_output_interval_and_in_the_end(tmp_path, when, times):
    recorder, *_ = record(tmp_path, **when)
    assert list(read_series(recorder.series)) == pytest.approx(times)


def test_files_are_readable_while_the_run_goes_on(tmp_path):
    scene = make_scene()
    recorder = rf.Recorder(scene, tmp_path, every=1)
    for k, report in enumerate(rf.simulate(scene, 0.1, 0.2, progress=False), start=1):
        recorder.write(report)
        assert len(read_series(recorder.series)) == k
        assert rf.read_history(recorder.history)["t"].size == k
    recorder.close()


def test_series_stays_whole_when_there_is_no_space_left(tmp_path):
    body = Body(rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), MATERIAL).space)
    series = Series(tmp_path / "fields.pvd", body)
    for k in range(120):
        series.write(float(k), {}, {})
    before = series.path.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 10, hard))
    try:
        with pytest.raises(OSError, match=r"space|large"):
            series.write(120.0, {}, {})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (tmp_path / "fields" / "fields_000120.vtu").exists()  # it was the .pvd that failed
    assert series.path.read_bytes() == before
    series.write(120.0, {}, {})
    assert list(read_series(series.path)) == [float(k) for k in range(121)]


def test_second_run_takes_the_place_of_the_first(tmp_path):
    record(tmp_path)
    recorder, *_ = record(tmp_path, every=100)
    assert len(list(tmp_path.glob("fields/*"))) == len(read_series(recorder.series)) == 2


def test_package_is_imported_without_graphics():
    code = "import sys, rigidfx.plot, rigidfx.plot.shapes; print(*sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    known = {"matplotlib", "paraview", "pyvista", "vtkmodules", "meshio"}
    assert not known & set(out.stdout.split())


# Bodies ----------------------------------------------------------------------------------------


def record_switches(folder, t_end=0.5):
    """A spinning bar whose ends become rigid and are released; the numbers of each step."""
    domain = rf.box((0, 0, 0), (6, 1, 1), (6, 1, 1))
    domain = domain.with_cells("middle", lambda x: np.abs(x[0] - 3) < 1 + 1e-9)
    spin = rf.InitialVelocity(angular=(0.2, 0.1, 0.5))
    scene = rf.Scene(domain, MATERIAL, [spin], probes={"end": (6.0, 0.5, 0.5)})
    release = rf.Release(at=0.4) if t_end < 1.0 else ()
    criterion = rf.StrainRate(1e9, 0.2, never="middle", release=release, wake="none")
    body, reports, rates = Body(scene.space), [], []
    with rf.Recorder(scene, folder, every=1, format="both") as recorder:
        for report in rf.simulate(scene, 0.1, t_end, rigidify=criterion, progress=False):
            recorder.write(report)
            reports.append(report)
            rates.append(body.on_cells(report.strain_rate))
    return recorder, reports, rates


LEFT, MIDDLE, RIGHT = (0.5, 1.5), (2.5, 3.5), (4.5, 5.5)  # middles of cells


def cells_along(grid):
    """Middles of the cells along the undeformed bar."""
    X = grid_points(grid)
    return [
        round(float(np.mean(X[[grid.GetCell(c).GetPointId(k) for k in range(8)], 0])), 9)
        for c in range(grid.GetNumberOfCells())
    ]


def test_series_shows_bodies_and_strain_rates(tmp_path):
    """At every time, of the partition and the step that end there."""
    recorder, reports, rates = record_switches(tmp_path)
    grids = read_series(recorder.series)
    assert list(grids) == [r.t for r in reports]
    for (t, grid), rate in zip(grids.items(), rates, strict=True):
        x = cells_along(grid)
        numbers = dict(zip(x, cell_data(grid, "body").tolist(), strict=True))
        ends = (1, 2) if 0.15 < t < 0.35 else (0, 0)
        for cells, number in zip((LEFT, MIDDLE, RIGHT), (ends[0], 0, ends[1]), strict=True):
            assert [numbers[c] for c in cells] == [number, number]
        np.testing.assert_array_equal(cell_data(grid, "level") > 0, cell_data(grid, "body") > 0)
        np.testing.assert_array_equal(cell_data(grid, "strain_rate"), rate)
        still = np.isin(x, LEFT + RIGHT) & (0.15 < t < 0.45)  # released at the end of a step
        np.testing.assert_array_equal(cell_data(grid, "strain_rate") > 0, ~still & (t > 0))


def test_velocities_of_probes_are_those_after_switches(tmp_path):
    """As those of the fields are: what becomes rigid at the end of a step has another motion."""
    recorder, reports, _ = record_switches(tmp_path)
    h = rf.read_history(recorder.history)
    for k, (grid, report) in enumerate(
        zip(read_series(recorder.series).values(), reports, strict=True)
    ):
        end = grid_points(grid)[:, 0] > 6 - 1e-9
        mean = point_data(grid, "velocity")[end].mean(axis=0)
        np.testing.assert_allclose(report.velocities["end"], mean, atol=1e-12)
        np.testing.assert_array_equal([h[f"v_end_{x}"][k] for x in "xyz"], report.velocities["end"])


def test_series_holds_stresses(tmp_path):
    """Nine components, which ParaView takes for a tensor, and von Mises' of them."""
    scene = make_scene()
    body, measure, stresses = Body(scene.space), CauchyStress(scene), []
    with rf.Recorder(scene, tmp_path / "with", every=1) as recorder:
        for report in rf.simulate(scene, 0.1, 0.3, progress=False):
            recorder.write(report)
            stresses.append(body.on_cells(measure.measure(report.state.u)))
    for grid, stress in zip(read_series(recorder.series).values(), stresses, strict=True):
        assert grid.GetCellData().GetArray("cell_stress").GetNumberOfComponents() == 9
        np.testing.assert_array_equal(cell_data(grid, "cell_stress").reshape(-1, 3, 3), stress)
        np.testing.assert_array_equal(cell_data(grid, "cell_von_mises"), von_mises(stress))
        nodal = point_data(grid, "stress").reshape(-1, 3, 3)
        np.testing.assert_array_equal(point_data(grid, "von_mises"), von_mises(nodal))
    assert von_mises(stresses[-1]).max() > 100.0
    without, *_ = record(tmp_path / "without", stress=False)
    for grid in read_series(without.series).values():
        assert grid.GetCellData().GetNumberOfArrays() == 1


def test_bodies_have_a_row_at_each_time_of_the_fields(tmp_path):
    recorder, reports, _ = record_switches(tmp_path)
    rows = table(recorder.bodies)
    pairs = [(r.t, b) for r in reports for b in r.bodies]
    assert len(rows) == len(pairs) == 4
    for row, (t, body) in zip(rows, pairs, strict=True):
        assert float(row["t"]) == t
        assert row["name"] == body.name
        for name in ("number", "cells", "mass", "kinetic", "stored"):
            assert float(row[name]) == getattr(body, name)
        for name in ("centre", "velocity", "angular_velocity"):
            vector = [float(row[f"{name}_{axis}"]) for axis in "xyz"]
            np.testing.assert_array_equal(vector, getattr(body, name))
        turn = Rotation.from_rotvec([float(row[f"rotation_{axis}"]) for axis in "xyz"])
        np.testing.assert_allclose(turn.as_matrix(), body.orientation, atol=1e-14)


def test_bodies_are_written_with_the_fields_only(tmp_path):
    domain = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)).with_cells("hub", lambda x: x[0] < 1 + 1e-9)
    spin = rf.InitialVelocity(angular=(0.2, 0.1, 0.5))
    scene = rf.Scene(domain, MATERIAL, [spin, rf.Rigid("hub")])
    with rf.Recorder(scene, tmp_path, every=3) as recorder:
        for report in rf.simulate(scene, 0.1, 0.5, progress=False):
            recorder.write(report)
    times = [float(row["t"]) for row in table(recorder.bodies)]
    assert times == list(read_series(recorder.series)) == pytest.approx([0.0, 0.3, 0.5])


def wait_for(condition, process, seconds=60.0):
    """Wait until a condition holds while a process runs."""
    end = monotonic() + seconds
    while not condition():
        assert process.poll() is None, process.communicate()
        assert monotonic() < end, "nothing happens"
        sleep(0.005)


@pytest.mark.slow
@pytest.mark.parametrize(("how", "times"), [("KILL", 8), ("INT", 5)])
def test_files_of_a_run_that_was_stopped(tmp_path, how, times):
    """Up to the last written time all is there, wherever it was stopped."""
    command = [sys.executable, __file__, str(tmp_path), "endless"]
    pvd = tmp_path / "fields.pvd"
    with subprocess.Popen(
        command,
        env=launch(1)[1],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        # A shell's background job ignores SIGINT, and so would this process.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        try:
            wait_for(lambda: pvd.exists() and pvd.read_text().count("DataSet") >= times, process)
            process.send_signal(getattr(signal, f"SIG{how}"))
            _, err = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode != 0
    assert how == "KILL" or b"KeyboardInterrupt" in err
    grids = read_series(pvd)
    assert len(grids) >= times
    assert all(cell_data(grid, "cell_stress").shape == (6, 9) for grid in grids.values())
    h = rf.read_history(tmp_path / "history.csv")
    np.testing.assert_allclose(np.diff(h["t"]), 0.1, rtol=1e-9)
    assert h["t"][-1] >= max(grids)
    rows = table(tmp_path / "bodies.csv")
    numbers = {float(row["t"]): 0 for row in rows}
    for row in rows:
        assert None not in row.values()
        numbers[float(row["t"])] += 1
    for t in sorted(grids)[:-1]:  # bodies follow the fields
        assert numbers.get(t, 0) == cell_data(grids[t], "body").max()
    assert len(table(tmp_path / "events.csv")) == 2
    fields = rf.read_fields(tmp_path / "fields.vtkhdf")
    assert fields.times.size in (len(grids), len(grids) - 1)  # it is written after the .pvd
    for t, u in zip(fields.times, fields["displacement"], strict=True):
        np.testing.assert_array_equal(u, point_data(grids[t], "displacement"))
    pyvista = pytest.importorskip("pyvista")
    reader = pyvista.PVDReader(pvd)
    assert list(reader.time_values) == sorted(grids)
    reader.set_active_time_value(max(grids))
    assert reader.read()[0].n_cells == 6


def test_history_may_end_within_a_row(tmp_path):
    recorder, reports, _ = record(tmp_path)
    text = recorder.history.read_bytes()
    recorder.history.write_bytes(text[:-30])
    assert rf.read_history(recorder.history)["t"].size == len(reports) - 1


def test_events_have_a_row_for_each_body(tmp_path):
    recorder, reports, _ = record_switches(tmp_path)
    with recorder.events.open(newline="") as file:
        rows = list(csv.DictReader(file))
    pairs = [(e, c) for r in reports for e in r.events for c in e.changes]
    names = [(row["kind"], row["name"]) for row in rows]
    assert names == [(kind, f"part {n}") for kind in ("freeze", "release") for n in (1, 2)]
    assert [row["reason"] for row in rows] == [e.reason for e, _ in pairs]
    for row, (event, change) in zip(rows, pairs, strict=True):
        for column in ("t", "unknowns_before", "unknowns_after", "energy_frozen",
                       "energy_released", "energy_lost", "work_of_supports", "work_of_motors",
                       "linear_momentum_error", "angular_momentum_error"):  # fmt: skip
            assert float(row[column]) == getattr(event, column)
        for column in ("number", "cells_before", "cells_after", "stored_before", "stored_after"):
            assert float(row[column]) == getattr(change, column)
        for name in ("impulse", "angular_impulse"):
            assert [float(row[f"{name}_{axis}"]) for axis in "xyz"] == list(getattr(event, name))
    assert len(rows[0]) == 24
    h = rf.read_history(recorder.history)
    np.testing.assert_array_equal(h["bodies"], [len(r.bodies) for r in reports])
    np.testing.assert_array_equal(h["stored"], [r.stored for r in reports])
    assert h["bodies"].tolist() == [0, 0, 2, 2, 0, 0]


def test_runs_without_bodies_say_nothing_about_them(tmp_path):
    recorder, *_ = record(tmp_path)
    assert not recorder.events.exists()
    assert not recorder.bodies.exists()
    for grid in read_series(recorder.series).values():
        assert {grid.GetCellData().GetArrayName(k) for k in range(3)} == {
            *("material", "cell_stress", "cell_von_mises")
        }
        assert grid.GetCellData().GetNumberOfArrays() == 3


def test_script_for_paraview_is_beside_the_fields(tmp_path):
    """Valid for the oldest Python that the package knows, and needs nothing of the package."""
    recorder, *_ = record(tmp_path / "it's here", every=100)
    text = (recorder.folder / "view.py").read_text(encoding="utf-8")
    tree = ast.parse(text, feature_version=(3, 10))
    imported = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert imported == {"pathlib", "paraview"}
    (fields,) = (
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "FIELDS"
    )
    assert Path(fields) == recorder.folder.resolve()


@pytest.mark.skipif(shutil.which("pvbatch") is None, reason="there is no pvbatch")
def test_pvbatch_draws_what_is_rigid(tmp_path):
    """Dark where cells are rigid, light where they are not, at each time."""
    recorder, *_ = record_switches(tmp_path)
    window = ["xvfb-run", "-a"] if shutil.which("xvfb-run") else []
    command = [*window, "pvbatch", str(recorder.folder / "view.py"), "--film"]
    own = {name: value for name, value in os.environ.items() if not name.startswith("OMPI_")}
    subprocess.run(command, check=True, timeout=120, env=own)  # ParaView has an MPI of its own
    from matplotlib.image import imread

    dark = []
    for file in sorted(recorder.folder.glob("view_level.*.png")):
        red, _, blue = imread(file)[..., :3].transpose(2, 0, 1)
        dark.append(int(np.count_nonzero((blue > red + 0.05) & (blue < 0.35))))
    assert max(dark) > 100 * min(dark)  # the key is dark in any case


@pytest.mark.parallel
@pytest.mark.parametrize(("cell", "order"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_files_of_several_ranks_are_those_of_one(tmp_path, cell, order):
    alone, *_ = record(tmp_path / "1", cell, order)
    mpirun(__file__, 2, 120, str(tmp_path / "2"), cell, str(order))
    serial, parallel = read_series(alone.series), read_series(tmp_path / "2" / "fields.pvd")
    assert list(serial) == list(parallel)
    for one, two in zip(serial.values(), parallel.values(), strict=True):
        np.testing.assert_allclose(grid_points(two), grid_points(one), atol=1e-14)
        for connectivity in ("GetConnectivityArray", "GetOffsetsArray"):
            a, b = (vtk_to_numpy(getattr(g.GetCells(), connectivity)()) for g in (one, two))
            np.testing.assert_array_equal(a, b)
        for name in ("displacement", "velocity"):
            a, b = point_data(one, name), point_data(two, name)
            np.testing.assert_allclose(b, a, atol=1e-9 * np.abs(a).max())
        for name in ("cell_stress", "cell_von_mises", "stress", "von_mises", "strain"):
            read = cell_data if name.startswith("cell") else point_data
            a, b = read(one, name), read(two, name)
            np.testing.assert_allclose(b, a, atol=1e-8 * max(np.abs(a).max(), 1.0))
        np.testing.assert_array_equal(cell_data(one, "material"), cell_data(two, "material"))
    h1, h2 = rf.read_history(alone.history), rf.read_history(tmp_path / "2" / "history.csv")
    assert list(h1) == list(h2)
    np.testing.assert_array_equal(h1["unknowns"], h2["unknowns"])
    np.testing.assert_allclose(h1["energy"], h2["energy"], rtol=1e-9)


@pytest.mark.parallel
def test_bodies_of_several_ranks_are_those_of_one(tmp_path):
    record_switches(tmp_path / "1")
    mpirun(__file__, 2, 120, str(tmp_path / "2"), "switches")
    one, two = (read_series(tmp_path / ranks / "fields.pvd") for ranks in ("1", "2"))
    assert list(one) == list(two)
    for a, b in zip(one.values(), two.values(), strict=True):
        for name in ("body", "rigid"):
            np.testing.assert_array_equal(cell_data(a, name), cell_data(b, name))
        rate = cell_data(a, "strain_rate")
        np.testing.assert_allclose(cell_data(b, "strain_rate"), rate, atol=1e-9 * rate.max())
    rows = []
    for ranks in ("1", "2"):
        with (tmp_path / ranks / "events.csv").open(newline="") as file:
            rows.append(list(csv.DictReader(file)))
    for a, b in zip(*rows, strict=True):
        for column in ("t", "kind", "name", "number", "cells_before", "cells_after"):
            assert a[column] == b[column]
        assert float(b["stored_after"]) == pytest.approx(float(a["stored_after"]), rel=1e-9)


if __name__ == "__main__":
    try:
        if sys.argv[2:] == ["endless"]:
            record_switches(sys.argv[1], t_end=1e4)
        elif sys.argv[2:] == ["switches"]:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.filterwarnings("ignore", "Body|Scene: first-order")  # coarse cells
                record_switches(sys.argv[1])
        else:
            record(sys.argv[1], *sys.argv[2:3], *map(int, sys.argv[3:]))
    except rf.OutputError as error:
        messages = MPI.COMM_WORLD.gather(f"OutputError: {error}")
        if messages is not None:
            tell(messages)
