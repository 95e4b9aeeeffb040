"""How well conditioned are the equations of a step: rigid body, flexible stiff part, or penalty?

One half of a bar is `ratio` times as stiff as the other. Four ways to treat that half are compared,
for the same motion and the same Δt, by the 2-norm condition number of the tangent of one step:

* *reduced*: the stiff half is a rigid body in minimal coordinates, six unknowns;
* *flexible*: all cells are flexible, with their own E;
* *penalty*: all cells are flexible, and the nodes of the stiff half are tied besides by springs to
  the motion of six extra unknowns: p = 10³ times the largest diagonal entry of the flexible
  tangent, as a tie has to be stiffer than what it ties;
* *penalty, cells left out*: the cells of the stiff half are taken out, its nodes keep their masses,
  and p is 10³ times the largest diagonal entry of what is left.

All matrices are unit-free: rotations are multiplied by the length ℓ, moments divided by it, and
rows and columns scaled symmetrically by the square root of the diagonal (Jacobi), which is what a
Krylov solver with the simplest of preconditioners sees.

What comes out for a bar of 8 × 2 × 2 cells of 1 m and Δt = 0.1 s, in which a wave runs through
three cells of the soft half:

    E stiff / E soft   reduced   flexible   penalty   penalty, cells left out
                   1      15.4       16.3    1.1e+5                    1.1e+5
              10 000      15.4     1.5e+5    8.8e+8                    1.1e+5
         100 000 000      15.4     1.5e+9    8.8e+12                   1.1e+5

So the reduced system does not know how stiff its bodies are, while the flexible one's condition is
proportional to the ratio, once the stiffness outweighs the mass. A penalty multiplies either by
nearly 10⁴: most of it is p, the rest grows with the nodes of the body. Without a difference in
stiffness six unknowns in place of half the dofs gain next to nothing, as the soft half determines
the condition.

    ./fenicsx python3 demos/benchmarks/conditioning.py
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import rigidfx
from rigidfx.mechanics.rotation import skew
from rigidfx.plot.curves import figure_of, on_first_rank, save
from rigidfx.scene.timeline import Timeline
from rigidfx.simulation import prepare

E, NU, RHO = 1e4, 0.3, 10.0  # Pa, 1, kg/m³; of the soft half
DT = 0.1  # s
STEPS = 3  # steps before the tangent is looked at
RATIOS = (1.0, 1e4, 1e8)
PENALTY = 1e3  # p over the largest diagonal entry
SPIN = rigidfx.InitialVelocity(angular=(0.2, 0.3, 1.0))  # rad/s


def scene(ratio: float, rigid: bool, short: bool) -> rigidfx.Scene:
    """The bar with its stiff half rigid or flexible."""
    domain = rigidfx.box((0, 0, 0), (8, 2, 2), (4, 1, 1) if short else (8, 2, 2))
    domain = domain.with_cells("stiff", lambda x: x[0] <= 4 + 1e-9)
    domain = domain.with_cells("soft", lambda x: x[0] >= 4 - 1e-9)
    materials = {
        "stiff": rigidfx.StVenantKirchhoff(E=ratio * E, nu=NU, rho=RHO),
        "soft": rigidfx.StVenantKirchhoff(E=E, nu=NU, rho=RHO),
    }
    effects = [SPIN, rigidfx.Rigid("stiff")] if rigid else [SPIN]
    return rigidfx.Scene(domain, materials, effects)


def tangent(problem: rigidfx.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Dense tangent of the last step at its end, and the nodes' positions there."""
    run, _ = prepare(problem, Timeline(DT, STEPS * DT))
    with run.stepper as stepper:
        for k in range(STEPS):
            stepper.advance((k + 1) * DT)
        matrix = stepper.system.equilibrium.tangent_matrix.convert("aij")
        dense = np.array(matrix[:, :])
        matrix.destroy()
        x = stepper.state.X + stepper.state.u.x.array.reshape(-1, 3)
    return dense, x


def tied(K: np.ndarray, x: np.ndarray, nodes: np.ndarray, p: float) -> np.ndarray:
    """K with springs p |dᵢ - Δr - θ × vᵢ|²/2 between nodes and six extra unknowns (Δr, ℓθ)."""
    v = x[nodes] - x[nodes].mean(axis=0)
    length = np.sqrt((v**2).sum() / len(v))
    rows = (3 * nodes[:, None] + np.arange(3)).reshape(-1)
    L = np.concatenate([np.tile(np.eye(3), (len(v), 1)), -skew(v).reshape(-1, 3) / length], axis=1)
    n = len(K)
    out = np.zeros((n + 6, n + 6))
    out[:n, :n] = K
    out[rows, rows] += p
    out[rows, n:] = -p * L
    out[n:, rows] = -p * L.T
    out[n:, n:] = p * L.T @ L
    return out


def condition(A: np.ndarray) -> float:
    """2-norm condition number of D⁻½ A D⁻½, D the diagonal of A."""
    d = 1 / np.sqrt(np.abs(np.diag(A)))
    return float(np.linalg.cond(d[:, None] * A * d))


def compare(ratio: float, short: bool) -> dict[str, float]:
    """Condition numbers of the four treatments."""
    reduced, _ = tangent(scene(ratio, rigid=True, short=short))
    problem = scene(ratio, rigid=False, short=short)
    flexible, x = tangent(problem)
    nodes = problem.nodes("stiff", "benchmark")
    # What is left without the stiff cells: theirs are next to nothing, and masses are lumped.
    bare, _ = tangent(scene(1e-9, rigid=False, short=short))
    return {
        "reduced": condition(reduced),
        "flexible": condition(flexible),
        "penalty": condition(tied(flexible, x, nodes, PENALTY * np.diag(flexible).max())),
        "penalty, cells left out": condition(tied(bare, x, nodes, PENALTY * np.diag(bare).max())),
    }


def draw(rows: dict[float, dict[str, float]], path: Path) -> None:
    """Condition numbers against the ratio of the moduli."""
    figure, axes = figure_of(1, 1, (8.0, 5.0), "Condition of one step's equations")
    ax = axes[0, 0]
    for name, style in zip(next(iter(rows.values())), ("o-", "s-", "^-", "v--"), strict=True):
        ax.loglog(list(rows), [row[name] for row in rows.values()], style, label=name)
    ax.set_xlabel("E of the stiff half / E of the soft half")
    ax.set_ylabel("condition number\n(2-norm, unit-free, Jacobi-scaled)")
    ax.legend()
    save(figure, path)


def main() -> None:
    """Print the table, write summary.json, table.csv and a picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/conditioning"))
    parser.add_argument("--short", action="store_true", help="4 × 1 × 1 cells")
    arguments = parser.parse_args()
    if MPI.COMM_WORLD.size > 1:
        raise SystemExit("dense matrices: run this on one rank")
    rows = {ratio: compare(ratio, arguments.short) for ratio in RATIOS}
    names = list(rows[RATIOS[0]])
    print(f"{'ratio':>8}" + "".join(f"{name:>26}" for name in names))
    for ratio, row in rows.items():
        print(f"{ratio:8.0e}" + "".join(f"{row[name]:26.3g}" for name in names))
    arguments.out.mkdir(parents=True, exist_ok=True)
    with open(arguments.out / "table.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["ratio", *names])
        writer.writerows([ratio, *row.values()] for ratio, row in rows.items())
    summary = {
        "dt": DT,
        "penalty_over_largest_diagonal": PENALTY,
        "condition": {f"{ratio:g}": row for ratio, row in rows.items()},
    }
    (arguments.out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    picture = arguments.out / "conditioning.png"
    on_first_rank(MPI.COMM_WORLD, lambda: draw(rows, picture), f"conditioning: '{picture}'")
    reduced = [row["reduced"] for row in rows.values()]
    # The stiffness of a rigid body appears nowhere.
    assert max(reduced) <= min(reduced) * (1 + 1e-6), reduced
    for ratio, row in rows.items():
        assert row["reduced"] <= row["flexible"] * (1 + 1e-6), (ratio, row)
        assert 100 * row["reduced"] < min(row["penalty"], row["penalty, cells left out"]), row


if __name__ == "__main__":
    main()
