"""PETSc's options: from the environment, the command line and Python; honoured or refused."""

import subprocess
import sys

import pytest
from histories import heard
from parallel import launch

import rigidfx as rf

MATERIAL = rf.NeoHooke(E=1e4, nu=0.3, rho=1.0)


def make_scene(cells=(6, 2, 2)):
    """A bar that is pulled; by default 162 unknowns, enough for GMRES if a solver is chosen."""
    pulled = [rf.Fixed("x0"), rf.Traction("x1", (0.0, 0.0, 50.0))]
    return rf.Scene(rf.box((0, 0, 0), (6, 1, 1), cells), MATERIAL, pulled)


def run(steps=2, cells=(6, 2, 2), **options):
    scene = make_scene(cells)
    return list(rf.simulate(scene, 0.1, 0.1 * steps, progress=False, **options))[1:]


def test_options_hold_for_their_run_only(petsc_options):
    scene = make_scene()
    mine = rf.simulate(scene, 0.1, 0.3, petsc_options={"ksp_type": "bcgs"})
    others = rf.simulate(make_scene(), 0.1, 0.3)
    solvers = [(a.solver, b.solver) for a, b in zip(mine, others, strict=True)][1:]
    assert solvers == [("bcgs+ilu", "kept preonly+lu")] * 3
    assert not petsc_options.getAll()


def test_options_from_elsewhere_win(petsc_options):
    petsc_options["ksp_type"] = "fgmres"
    given = {"ksp_type": "bcgs", "pc_type": "jacobi"}
    assert run(petsc_options=given)[0].solver == "fgmres+jacobi"


@pytest.mark.parametrize("where", ["environment", "command line", "both"])
def test_options_from_outside(where):
    """What is behind --petsc is not seen by the script's own parser."""
    code = (
        "import argparse, sys, test_petsc_options as t\n"
        "parser = argparse.ArgumentParser()\n"
        "parser.add_argument('--steps', type=int)\n"
        "print(t.run(parser.parse_args().steps)[0].solver)\n"
    )
    inside, outside = "-rigidfx_ksp_type bcgs", "-rigidfx_ksp_type fgmres"
    command = [sys.executable, "-c", code, "--steps", "1"]
    if where != "environment":
        command += ["--petsc", *inside.split()]
    env = launch(1)[1] | ({} if where == "command line" else {"PETSC_OPTIONS": outside})
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ("fgmres+ilu" if where == "environment" else "bcgs+ilu")


def test_a_tolerance_of_the_linear_solver_has_an_effect():
    counts = [run(petsc_options={"ksp_rtol": tol})[0].linear_iterations for tol in (1e-12, 1e-2)]
    per_step = [run(petsc_options={"ksp_rtol": tol})[0].iterations for tol in (1e-12, 1e-2)]
    assert counts[0] / per_step[0] > 1.5 * counts[1] / per_step[1]


def test_a_monitor_sees_each_iterate():
    seen = []
    reports = run(monitor=lambda k, norm: seen.append((k, norm)))
    wanted = [(k, norm) for r in reports for k, norm in enumerate(r.residuals)]
    assert [k for k, _ in seen] == [k for k, _ in wanted]
    assert [norm for _, norm in seen] == pytest.approx([norm for _, norm in wanted])


def test_what_a_monitor_raises_is_raised():
    with pytest.raises(ZeroDivisionError):
        run(monitor=lambda k, norm: 1 / 0)


REFUSED = {
    "snes_atol": 1e-8,
    "snes_stol": 1e-8,
    "snes_divergence_tolerance": 10,
    "snes_convergence_test": "default",
    "snes_max_funcs": 1,
    "snes_type": "ksponly",
    "snes_mf_operator": None,
    "snes_mf": True,
    "snes_fd": "",
}


@pytest.mark.parametrize("name", REFUSED)
@pytest.mark.parametrize("where", ["database", "argument"])
def test_what_cannot_be_honoured_is_refused(petsc_options, name, where):
    given = {name: REFUSED[name]}
    if where == "database":
        petsc_options[name] = "" if given[name] is None else given[name]
        given = {}
    with pytest.raises(rf.SceneError, match=f"-rigidfx_{name} .*cannot be honoured"):
        run(petsc_options=given)


@pytest.mark.parametrize(
    ("given", "solver"),
    [
        ({"ksp_type": "bcgs"}, "bcgs+ilu"),
        ({"ksp_type": "cg", "pc_type": "asm"}, "cg+asm"),
        ({"pc_type": "cholesky"}, "gmres+cholesky"),
        ({"pc_type": "lu"}, "gmres+lu"),
        ({"ksp_type": "preonly", "pc_type": "lu"}, "preonly+lu"),
    ],
)
def test_the_usual_solvers_are_honoured(given, solver):
    first, second = run(petsc_options=given)
    assert first.solver == second.solver == solver
    assert first.cuts == second.cuts == 0


def said(**options):
    """What a run warns of that concerns its options."""
    with heard("petsc_options") as found:
        run(**options)
    return found


@pytest.mark.parametrize(
    "given", [{"ksp_rtoll": 1e-3}, {"mat_foo": 1}, {"mat_type": "dense"}, {"snes_divtol": 1}]
)
def test_what_nobody_asks_for_is_named_once(given):
    (message,) = said(petsc_options=given | {"ksp_rtol": 1e-8})
    assert f"no solver at work has asked for '{next(iter(given))}', which" in message


def test_what_solvers_ask_for_is_no_news(petsc_options):
    """At once, when they are set up, or later; and what an option from elsewhere is before."""
    known = {"snes_rtol": 1e-11, "snes_max_it": 20, "ksp_atol": 1e-30, "ksp_gmres_restart": 20}
    assert not said(petsc_options=known | {"ksp_max_it": 90, "pc_factor_levels": 1})
    hybrid = {"pc_type": "bjacobi", "sub_pc_type": "ilu", "sub_ksp_type": "preonly"}
    assert not said(petsc_options=hybrid | {"mat_mumps_icntl_14": 50, "snes_lag_jacobian": 1})
    petsc_options["ksp_rtol"] = "1e-9"
    assert not said(petsc_options={"ksp_rtol": 1e-8, "snes_linesearch_type": "basic"})
