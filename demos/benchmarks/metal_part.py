"""What a step of a metal part costs with tangents that are kept, against one with a new one each.

Steel, second-order tetrahedra, consistent mass and 15 to 40 steps to the period of the first
bending motion, as users have it, bent no further than steel stays elastic: waves pass some hundred
cells in a step, Krylov methods give up, and what a step costs is factorisations. Each part is
clamped at one end, or spins freely by 0.05 rad per step, and is pushed at the other end for half a
period. Beside each runs the same with a factorisation in each Newton iteration; the two take their
steps in turn. One part has four fifths rigid, beside the same all flexible, both with tangents that
are kept.

Others bend widely: a robot's arm through its move and swing, whose thin leaf turns by 30 degrees
against the rest, and a thin plate whose end moves by a third of its length. Their tangents fit only
if each node has a rotation of its own.

    ./fenicsx python3 demos/benchmarks/metal_part.py

`ratio_bending` is the worst of those that bend; `cases` has each one's `ratio_newton`,
`tangents_per_step`, `newton_per_step` and `seconds_per_step`. `ratio_to_factoring_always` and
`ratio_turning` are the worst of the clamped and of the turning parts, each the time of all its
steps, those with new tangents among them; `ratio_rigid` is that of the part four fifths of which
are rigid to itself all flexible.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import takewhile

import numpy as np
from bench import Parser, Turns, conclude

import rigidfx as rf
from meshes.robot_arm import HEIGHT, TIP, robot_arm

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0)  # Pa, 1, kg/m³
ALWAYS = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
TURN = 0.05  # rad per step
RIGID = 0.8  # of the length, from the free end
STRESS = 1.5e8  # Pa, at the root of a cantilever at rest; in motion it is up to twice that


@dataclass(frozen=True)
class Part:
    """A box of steel with some motion.

    Attributes:
        name: For the summary.
        size: Edges [m].
        cells: Cells along them, cut into tetrahedra.
        per_period: Steps per period of the first bending motion.
        turning: Whether it spins freely, or is clamped.
    """

    name: str
    size: tuple[float, float, float]
    cells: tuple[int, int, int]
    per_period: int
    turning: bool = False

    @property
    def dt(self) -> float:
        """Δt [s], by the theory of beams."""
        length, _, thickness = self.size
        frequency = 0.1615 * thickness / length**2 * np.sqrt(STEEL.E / STEEL.rho)
        return float(1 / frequency / self.per_period)

    def scene(self, rigid: bool = False) -> rf.Scene:
        """The problem, with the free end rigid, or all flexible."""
        box = rf.box((0, 0, 0), self.size, self.cells, cell="tetrahedron")
        x, y, z = self.size
        box = box.with_cells("end", lambda at: at[0] >= (1 - RIGID - 1e-9) * x)
        pressure = STRESS * z / (6 * self.size[0])
        push = rf.Traction("x1", (0, 0, pressure), until=self.per_period / 2 * self.dt)
        rate = TURN / self.dt
        spin = rf.InitialVelocity(angular=(0.2 * rate, rate, 0.1 * rate))
        return rf.Scene(
            box,
            STEEL,
            [push, spin if self.turning else rf.Fixed("x0"), *([rf.Rigid("end")] * rigid)],
            order=2,
            mass="consistent",
            probes={"tip": (self.size[0], y / 2, z / 2)},
        )


BAR, PLATE, BLOCK = (1.0, 0.2, 0.2), (1.0, 0.8, 0.1), (1.0, 0.5, 0.4)
PARTS = (
    Part("clamped bar", BAR, (20, 4, 4), 40),
    Part("clamped bar, finer", BAR, (28, 5, 5), 25),
    Part("clamped plate", PLATE, (16, 12, 2), 25),
    Part("clamped block", BLOCK, (14, 7, 6), 15),
    Part("turning bar", BAR, (20, 4, 4), 25, turning=True),
    Part("turning block", BLOCK, (14, 7, 6), 25, turning=True),
)
WITH_RIGID_END = Part("clamped bar", BAR, (30, 5, 5), 25)
COARSE = (
    Part("clamped bar", BAR, (10, 2, 2), 25),
    Part("turning bar", BAR, (10, 2, 2), 25, turning=True),
)


@dataclass(frozen=True)
class Arm:
    """The arm of `demos/robot_arm.py`, all flexible, moved 50 mm to the side in 40 ms from rest.

    Attributes:
        name: For the summary.
        size: Largest edge of a cell [m].
    """

    name: str
    size: float
    dt = 1e-3  # s

    def scene(self) -> rf.Scene:
        """The problem."""
        move = rf.PrescribedMotion("bore", displacement=partial(_way, 0.05, 0.04), until=0.04)
        return rf.Scene(
            robot_arm(self.size, max(0.012, 0.6 * self.size)),
            rf.StVenantKirchhoff(E=7e10, nu=0.33, rho=2700.0),
            [move, rf.Fixed("bore", since=0.04), rf.NumericalDamping(0.05)],
            order=2,
            mass="consistent",
            probes={"tip": (TIP, 0.0, HEIGHT / 2)},
        )


def _way(distance: float, travel: float, t: float) -> tuple[float, float, float]:
    """A smooth way along y: the displacement at t [m]."""
    s = np.clip(t / travel, 0.0, 1.0)
    return 0.0, distance * (s - np.sin(2 * np.pi * s) / (2 * np.pi)), 0.0


@dataclass(frozen=True)
class Plate:
    """A thin plate of second-order hexahedra, clamped at one end, that bends by a third of itself.

    Attributes:
        name: For the summary.
        size: Edges [m].
        cells: Cells along them.
        per_period: Steps per period of the first bending motion.
    """

    name: str
    size: tuple[float, float, float] = (0.3, 0.1, 0.003)
    cells: tuple[int, int, int] = (16, 5, 1)
    per_period: int = 40

    @property
    def dt(self) -> float:
        """Δt [s], by the theory of beams."""
        return Part(self.name, self.size, self.cells, self.per_period).dt

    def scene(self) -> rf.Scene:
        """The problem: half of the static force for a third, for half a period."""
        length, width, thickness = self.size
        force = 0.5 * STEEL.E * width * thickness**3 / 12 / length**2
        push = rf.Traction(
            "x1", (0, 0, force / width / thickness), until=self.per_period / 2 * self.dt
        )
        return rf.Scene(
            rf.box((0, 0, 0), self.size, self.cells),
            STEEL,
            [rf.Fixed("x0"), push],
            order=2,
            mass="consistent",
            probes={"tip": (length, width / 2, thickness / 2)},
        )


BENDING = (Arm("arm", 0.012), Arm("arm, finer", 0.009), Plate("bending plate"))
BENDING_COARSE = (Plate("bending plate", cells=(8, 3, 1)),)


def measure(part: Part | Arm | Plate, steps: int) -> dict[str, object]:
    """The two runs of a part."""
    runs = {
        name: rf.simulate(part.scene(), part.dt, 1e6, progress=False, petsc_options=options)
        for name, options in (("kept", {}), ("always", ALWAYS))
    }
    with Turns(runs) as turns:
        for _ in range(steps):
            turns.take()
    kept, always = turns.reports["kept"], turns.reports["always"]
    # A step that one of them halves leads elsewhere: they are compared up to there.
    pairs = list(takewhile(lambda pair: pair[0].t == pair[1].t, zip(kept, always, strict=False)))
    tips = [np.array([report.probes["tip"] for report in run]) for run in zip(*pairs, strict=True)]
    apart = float(np.abs(tips[0] - tips[1]).max() / np.abs(tips[1]).max())
    assert apart <= 1e-8, f"{part.name}: the probe differs by {apart:.1e}"
    ratio = sum(turns.seconds["kept"]) / sum(turns.seconds["always"])
    return {
        "case": part.name,
        "unknowns": kept[-1].unknowns,
        "steps_per_period": getattr(part, "per_period", None),
        "ratio": ratio,
        "ratio_newton": ratio,
        "ratio_of_medians": turns.median("kept") / turns.median("always"),
        "seconds_per_step": {name: sum(s) / steps for name, s in turns.seconds.items()},
        "tangents_per_step": sum(report.tangents for report in kept) / steps,
        "newton_per_step": {name: turns.newton(name) for name in runs},
        "probe_apart": apart,
        "steps_compared": len(pairs),
        "solver": kept[-1].solver,
    }


def measure_rigid(part: Part, steps: int) -> dict[str, object]:
    """A part with its end rigid, and all flexible."""
    runs = {
        name: rf.simulate(part.scene(name == "rigid"), part.dt, 1e6, progress=False)
        for name in ("rigid", "flexible")
    }
    with Turns(runs) as turns:
        for _ in range(steps):
            turns.take()
    return {
        "case": f"{part.name}, four fifths rigid",
        "unknowns": {name: reports[-1].unknowns for name, reports in turns.reports.items()},
        "ratio": sum(turns.seconds["rigid"]) / sum(turns.seconds["flexible"]),
        "seconds_per_step": {name: sum(s) / steps for name, s in turns.seconds.items()},
        "newton_per_step": {name: turns.newton(name) for name in runs},
        "solver": {name: reports[-1].solver for name, reports in turns.reports.items()},
    }


def main() -> None:
    """Run the comparison and write its summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="1700 unknowns, few steps")
    parser.add_argument("--steps", type=int, default=120, help="timed steps of each part")
    options = parser.read(steps=6)
    cases = []
    for part in COARSE if options.short else PARTS:
        cases.append(measure(part, options.steps))
        print(cases[-1])

    bending = []
    for part in BENDING_COARSE if options.short else BENDING:
        bending.append(measure(part, min(options.steps, 97)))  # three go before
        print(bending[-1])

    rigid = measure_rigid(COARSE[0] if options.short else WITH_RIGID_END, options.steps)
    print(rigid)

    def worst(turning: bool) -> float:
        return max(case["ratio"] for case in cases if ("turning" in case["case"]) == turning)

    summary = {
        "ratio_to_factoring_always": worst(turning=False),
        "ratio_turning": worst(turning=True),
        "ratio_bending": max(case["ratio"] for case in bending),
        "ratio_rigid": rigid["ratio"],
        "cases": cases + bending,
        "rigid_end": rigid,
    }
    conclude(options.out, summary)


if __name__ == "__main__":
    main()
