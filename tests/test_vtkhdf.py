"""All times of a run in one file: read by VTK, by h5py, and as arrays; whole at any instant."""

import os
import resource
import signal
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from test_output import cell_data, point_data, read_series, record

import rigidfx as rf
from rigidfx.output import whole_writes
from rigidfx.output.paraview import Cloud, Series
from rigidfx.output.vtkhdf import HdfSeries

h5py = pytest.importorskip("h5py")
vtk_hdf = pytest.importorskip("vtkmodules.vtkIOHDF")

pytestmark = [
    pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="one rank is enough"),
    pytest.mark.filterwarnings("ignore:.* acts with a jolt"),
]

SINGLE = 2.0**-24  # relative rounding of single precision


def cloud(count=5):
    points = np.arange(3.0 * count).reshape(count, 3)
    return Cloud(points, np.arange(count, dtype=np.int32)[:, None])


def add(series, k, count=5):
    """A time whose values tell its number; m changes at every third."""
    tensors = np.full((count, 3, 3), float(k))
    points = {"displacement": np.full((count, 3), k / 3), "stress": tensors}
    series.write(float(k), points, {"m": np.full(count, k // 3, np.int32)})


def read_by_vtk(path):
    """Grids by their times, also out of order."""
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

    reader = vtk_hdf.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    grids = {}
    for t in reversed(times):
        reader.UpdateTimeStep(t)
        assert reader.GetErrorCode() == 0
        grids[t] = vtkUnstructuredGrid()
        grids[t].DeepCopy(reader.GetOutput())
    return dict(sorted(grids.items()))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with both kinds of files, and its reports."""
    folder = tmp_path_factory.mktemp("run")
    recorder, reports, fields = record(folder, format="both", peaks=("z0", "high"))
    return SimpleNamespace(folder=folder, recorder=recorder, reports=reports, fields=fields)


def test_vtk_reads_the_same_from_both(run):
    """Times, cells, and fields: displacements as they are, others in single precision."""
    old, new = read_series(run.recorder.series), read_by_vtk(run.folder / "fields.vtkhdf")
    assert list(old) == list(new) == [r.t for r in run.reports]
    for a, b in zip(old.values(), new.values(), strict=True):
        kinds = [[g.GetCellType(c) for c in range(g.GetNumberOfCells())] for g in (a, b)]
        nodes = [[g.GetCell(c).GetPointId(7) for c in range(20)] for g in (a, b)]
        assert kinds[0] == kinds[1]
        assert nodes[0] == nodes[1]
        np.testing.assert_array_equal(point_data(b, "displacement"), point_data(a, "displacement"))
        np.testing.assert_array_equal(cell_data(b, "material"), cell_data(a, "material"))
        for name in ("velocity", "von_mises"):
            x, y = point_data(a, name), point_data(b, name)
            np.testing.assert_allclose(y, x, rtol=2 * SINGLE)
        six = [0, 4, 8, 1, 5, 2]  # xx, yy, zz, xy, yz, xz among nine
        x, y = cell_data(a, "cell_stress")[:, six], cell_data(b, "cell_stress")
        np.testing.assert_allclose(y, x, rtol=2 * SINGLE)


def test_fields_as_arrays(run):
    """From either file, and from the folder; by name, by time, and as a mesh of pyvista."""
    files = [rf.read_fields(run.folder / name) for name in ("", "fields.vtkhdf", "fields.pvd")]
    for fields in files:
        assert fields.times.tolist() == [r.t for r in run.reports]
        u = np.stack([u for u, _ in run.fields])
        np.testing.assert_array_equal(fields["displacement"], u)
        assert fields["strain"].shape == (*u.shape, 3)
        assert fields["cell_stress"].shape[1:] == (20, 3, 3)
        for t, k in ((0.26, 3), (None, -1)):
            np.testing.assert_array_equal(fields.at(t)["displacement"], u[k])
        with pytest.raises(
            rf.SceneError, match=r"no field 'speed'. On nodes: .*velocity.*material"
        ):
            fields["speed"]
    np.testing.assert_array_equal(files[1]["stress"], files[2]["stress"].astype(np.float32))
    pytest.importorskip("pyvista")
    for fields in files:
        grid, lain = fields.mesh(0.5, scale=2.0), fields.mesh(0.5)
        moved = grid.points - lain.points
        np.testing.assert_allclose(moved, 2 * fields.at(0.5)["displacement"], atol=1e-12)
        assert grid.n_cells == 20
        assert grid.point_data["stress"].shape[1] == 9


def test_history_follows_probes_and_sets(run):
    """Velocities, mean accelerations, and the largest stress with its place."""
    h, fields = rf.read_history(run.folder), rf.read_fields(run.folder / "fields.pvd")
    tip = np.linalg.norm(fields.points - (1.0, 1.0, 3.0), axis=1).argmin()
    v = np.stack([v for _, v in run.fields])[:, tip]
    for axis, name in enumerate("xyz"):
        np.testing.assert_allclose(h[f"v_tip_{name}"], v[:, axis], atol=1e-14)
        mean = np.diff(v[:, axis]) / np.diff(h["t"])
        np.testing.assert_allclose(h[f"a_tip_{name}"][1:], mean, atol=1e-12)
    assert np.isnan(h["a_tip_x"][0])
    high = np.unique(fields.cells[fields.at(0.0)["material"] == 1])
    foot = np.flatnonzero(fields.points[:, 2] < 1e-9)
    for name, nodes in (("high", high), ("z0", foot)):
        of_nodes = fields["von_mises"][:, nodes]
        np.testing.assert_allclose(h[f"peak_{name}"], of_nodes.max(axis=1), rtol=1e-12)
        places = np.stack([h[f"peak_{name}_{axis}"] for axis in "xyz"], axis=1)
        for place, values in zip(places[1:], of_nodes[1:], strict=True):
            at = np.linalg.norm(fields.points[nodes] - place, axis=1)
            assert values[at < 1e-9].max() == pytest.approx(values.max(), rel=1e-12)


def test_history_is_a_table_of_pandas_where_that_is(run, monkeypatch):
    """Pictures take either."""
    columns = rf.read_history(run.folder)

    class Table(dict):
        columns = property(list)

    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=Table))
    table = rf.read_history(run.folder)
    assert isinstance(table, Table)
    assert list(table) == list(columns)


# Whole at any instant --------------------------------------------------------------------------


def test_file_is_whole_after_every_call_of_the_system(tmp_path, monkeypatch):
    """Whatever is the last that a killed run has written, all earlier times are there."""
    path, real, looks = tmp_path / "fields.vtkhdf", os.pwrite, []
    done = 0

    def write(file, data, place):
        written = real(file, data, place)
        with h5py.File(path) as f:
            root, steps = f["VTKHDF"], f["VTKHDF/Steps"]
            count = int(steps.attrs["NSteps"])
            assert done <= count <= done + 1
            assert len(steps["Values"]) == count  # VTK's reader overruns its space by others
            for k in {0, count // 2, count - 1} if count else ():
                assert steps["Values"][k] == k
                first = steps["PointDataOffsets/displacement"][k]
                assert (root["PointData/displacement"][first : first + 5] == k / 3).all()
                first = steps["CellDataOffsets/m"][k]
                assert (root["CellData/m"][first : first + 5] == k // 3).all()
            looks.append(count)
        return written

    series = HdfSeries(path, cloud())
    monkeypatch.setattr(whole_writes.os, "pwrite", write)
    for k in range(80):  # more than a node of HDF5's trees takes
        add(series, k)
        done += 1
    assert len(read_by_vtk(path)) == 80
    series.close()
    assert len(looks) > 2 * 80
    assert rf.read_fields(path).times.size == 80


def test_full_disk_leaves_the_file_as_before(tmp_path):
    series = HdfSeries(tmp_path / "fields.vtkhdf", cloud(500))
    for k in range(3):
        add(series, k, 500)
    size = series.path.stat().st_size
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + 100, hard))
    try:
        with pytest.raises(OSError, match=r"space|large"):
            add(series, 3, 500)
        assert rf.read_fields(series.path)["m"][:, 0].tolist() == [0, 0, 0]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    add(series, 3, 500)
    series.close()
    found = rf.read_fields(series.path)
    assert found.times.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert found["stress"][:, 7, 2, 2].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert found["m"][:, 499].tolist() == [0, 0, 0, 1]


def test_size_is_less_than_half(tmp_path):
    """Of 30 times of a cloud of 2000 points, which a .vtu has anew each time."""
    old, new = (
        Series(tmp_path / "a.pvd", cloud(2000)),
        HdfSeries(tmp_path / "b.vtkhdf", cloud(2000)),
    )
    for k in range(30):
        for series in (old, new):
            add(series, k, 2000)
    new.close()
    sizes = [file.stat().st_size for file in (tmp_path / "a").iterdir()]
    assert new.path.stat().st_size < 0.5 * sum(sizes)


# Bad input -------------------------------------------------------------------------------------


def test_without_h5py(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    scene = rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), rf.NeoHooke(E=1.0, nu=0.3, rho=1.0))
    with pytest.raises(rf.SceneError, match=r"needs the Python module h5py \(pip install h5py\)"):
        rf.Recorder(scene, tmp_path, format="vtkhdf")


def test_ctrl_c_waits_until_a_time_is_written(tmp_path, monkeypatch):
    """HDF5 is called from Python, and calls Python: an error there would leave it in the middle."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    series, write = HdfSeries(tmp_path / "fields.vtkhdf", cloud()), whole_writes.WholeWrites.write

    def interrupted(self, buffer):
        os.kill(os.getpid(), signal.SIGINT)
        return write(self, buffer)

    try:
        monkeypatch.setattr(whole_writes.WholeWrites, "write", interrupted)
        with pytest.raises(KeyboardInterrupt):
            add(series, 0)
    finally:
        monkeypatch.undo()
        signal.signal(signal.SIGINT, before)
    add(series, 1)
    series.close()
    assert rf.read_fields(series.path).times.tolist() == [0.0, 1.0]
