"""What a fully flexible step costs, against a straightforward DOLFINx + SNES loop.

Both integrate the tumbling L under a constant load with the same energy-momentum scheme, the same
quadrature, lumped mass, first guess and stopping test, one step each in turn, so that a change of
the machine's speed hits both alike; the ratio is the median of the steps' ratios. The plain loop is
what a DOLFINx user would write: one form with the inertia in it, default compiler options, an AIJ
matrix, an SNES.

Two comparisons are made:

* *same solver*: GMRES + ILU(0) to 1e-8 in every Newton iteration on both sides (and LU by MUMPS on
  both sides where the system is small enough) — `ratio_to_plain_dolfinx` is the first of these;
* *best against best*: rigidfx as it comes against the better of the plain loop's two solvers.

    ./fenicsx python3 demos/benchmarks/flexible_step.py --unknowns 27000
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from bench import DT, Parser, Turns, conclude
from bench.plain import PlainLoop
from petsc4py import PETSc

import rigidfx
from meshes.tumbling_l import tumbling_l

E, NU, RHO = 1e4, 0.3, 10.0  # Pa, 1, kg/m³
TRACTION = np.array([256.0, 512.0, 768.0]) / 90.0  # Pa
SAME_SOLVER = {
    "gmres+ilu": {"snes_ksp_ew": "0", "ksp_type": "gmres", "pc_type": "ilu", "ksp_rtol": "1e-8"},
    "lu": {
        "ksp_type": "preonly",
        "pc_type": "lu",
        "pc_factor_mat_solver_type": "mumps",
    },
}
LU_BELOW = 50_000  # unknowns; beyond, a factorisation takes gigabytes and most of a minute


def scene(refine: int, domain: rigidfx.Domain | None = None, order: int = 1) -> rigidfx.Scene:
    """The tumbling L with cells of edge 1/refine under a constant pair of tractions."""
    return rigidfx.Scene(
        domain or tumbling_l(refine),
        rigidfx.StVenantKirchhoff(E=E, nu=NU, rho=RHO),
        [
            rigidfx.Traction("top", tuple(TRACTION)),
            rigidfx.Traction("side", tuple(-TRACTION)),
        ],
        order=order,
    )


def stepper(problem: rigidfx.Scene, solver: dict[str, str]) -> Iterator[rigidfx.Report]:
    """Reports of rigidfx under given PETSc options."""
    options = PETSc.Options("rigidfx_")
    for name, value in solver.items():
        options[name] = value
    reports = rigidfx.simulate(problem, DT, 1e6, progress=False)
    next(reports)
    for name in solver:
        options.delValue(name)
    return reports


def compare(
    problem: rigidfx.Scene, ours: dict[str, str], plain: dict[str, str], steps: int
) -> dict[str, object]:
    """Interleaved steps of both loops."""
    reports = stepper(problem, ours)
    first = next(reports)
    tractions = {"top": lambda t: TRACTION, "side": lambda t: -TRACTION}
    loop = PlainLoop(problem, DT, tractions, plain, floor=2 * first.residuals[-1])
    next(loop)  # as far as rigidfx is
    with Turns({"rigidfx": reports, "plain": loop}, warm=0) as turns:
        for _ in range(steps):
            turns.take()
        both = turns.reports["rigidfx"], turns.reports["plain"]
        here = both[0][-1].state.u.x.array
        difference = float(np.abs(here - loop.u0.x.array).max() / np.abs(here).max())
    return {
        "ratio": turns.ratio("rigidfx", "plain"),
        "rigidfx_s": turns.median("rigidfx"),
        "plain_s": turns.median("plain"),
        "newton": [sum(step.iterations for step in run) for run in both],
        "linear": [sum(step.linear_iterations for step in run) for run in both],
        "solver": both[0][-1].solver,
        "difference": difference,
    }


def main() -> None:
    """Run the comparison and write its summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="700 unknowns, few steps")
    parser.add_argument("--unknowns", type=int, default=27_000, help="about 700, 27000, 200000")
    parser.add_argument("--steps", type=int, default=9, help="timed steps per comparison")
    parser.add_argument("--order", type=int, default=1, choices=(1, 2), help="of the hexahedra")
    options = parser.read(unknowns=700, steps=3)
    sizes = {len(tumbling_l_nodes(options.order * r)) * 3: r for r in range(1, 10)}
    unknowns = min(sizes, key=lambda n: abs(n - options.unknowns))
    problem = scene(sizes[unknowns], order=options.order)
    solvers = [name for name in SAME_SOLVER if name != "lu" or unknowns < LU_BELOW]
    same = {
        name: compare(problem, SAME_SOLVER[name], SAME_SOLVER[name], options.steps)
        for name in solvers
    }
    plain_best = min(solvers, key=lambda name: same[name]["plain_s"])
    best = compare(problem, {}, SAME_SOLVER[plain_best], options.steps)
    summary = {
        "ratio_to_plain_dolfinx": same["gmres+ilu"]["ratio"],
        "ratio_best_to_best": best["ratio"],
        "unknowns": unknowns,
        "same_solver": same,
        "best": best,
        "plain_best_solver": plain_best,
    }
    conclude(options.out, summary)
    for name, row in {**same, f"best (plain: {plain_best})": best}.items():
        print(
            f"{unknowns} unknowns, {name:24s} rigidfx {row['rigidfx_s']:.4f} s, plain "
            f"{row['plain_s']:.4f} s, ratio {row['ratio']:.2f}, Newton {row['newton']}, linear "
            f"{row['linear']}, difference {row['difference']:.1e}"
        )
    for name, row in [*same.items(), ("best", best)]:
        # Both solve the same equations to Newton's tolerance, or the comparison means nothing.
        assert row["difference"] < 1e-9, f"{name}: the two loops disagree by {row['difference']}"


def tumbling_l_nodes(refine: int) -> range:
    """Nodes of the L with cells of edge 1/refine, as a range to be counted."""
    a, b, c = 6 * refine + 1, 3 * refine + 1, 7 * refine
    return range(a * b * b + b * c * b)


if __name__ == "__main__":
    main()
