"""Time: long runs, large rotations, steps that see nothing of what vibrates, sudden loads."""

from collections.abc import Iterator

import numpy as np
from common import block_of

import rigidfx as rf

from .case import ANY, NEWTON, History, Run, both, case, few_freezes, release_at

SVK = rf.StVenantKirchhoff


def _spin(angle: float, dt: float) -> float:
    """Angular velocity that turns a body by an angle per step: ω Δt = 2 tan(angle/2)."""
    return 2 * np.tan(angle / 2) / dt


@case("time", "free spin: many steps, many revolutions, nothing that damps")
def free_spin(short: bool) -> Iterator[Run]:
    """n steps of 0.1 revolutions lose at most n times what ends Newton's iteration, 1e-12.

    1e5 steps, 1e4 revolutions; a tenth of a hundredth of it in the short version.
    """
    steps, dt = (300 if short else 100_000), 0.1
    omega = _spin(0.2 * np.pi, dt)
    scene = rf.Scene(
        rf.box((-1, -0.5, -0.25), (1, 0.5, 0.25), (2, 1, 1)),
        SVK(E=2e7, nu=0.3, rho=10.0),
        [rf.InitialVelocity(angular=(0.0, 0.0, omega))],
    )
    bounds = {"energy": max(steps * NEWTON, 1e-11), "momentum": max(steps * NEWTON, 1e-11)}
    yield from both(scene, dt, steps * dt, rf.StrainRate(ANY, 10 * dt), **bounds)


@case("time", "turns by 2.5 rad per step: u½ is not even half the size of the body")
def large_rotation_per_step(short: bool) -> Iterator[Run]:
    """H, L and J to Newton's tolerance, whatever the angle below π.

    About a principal axis no step is cut. Where the axis wanders, nodes that advance one by one
    leave the rigid motion within a step; Newton follows after a cut, to some 1.2 rad per step. A
    warning says that what turns so far lags behind.
    """
    dt = 0.1
    t_end = 3.0 if short else 30.0
    bounds = {"energy": 1e-9, "momentum": 1e-9, "warns": "rad per step"}
    skew = np.array([0.1, 0.2, 1.0]) / np.linalg.norm([0.1, 0.2, 1.0])
    for about, axis in (("principal axis", (0.0, 0.0, 1.0)), ("skew axis", skew)):
        spin = rf.InitialVelocity(angular=tuple(_spin(2.5, dt) * np.asarray(axis)))
        cut = {"tangents": 25, "cuts": round(2 * t_end / dt)} if about == "skew axis" else {}
        domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
        domain = domain.with_cells("left", lambda x: x[0] <= 2 + 1e-9)
        free = rf.Scene(domain, SVK(E=1e9, nu=0.3, rho=1.0), [spin])
        adaptive = rf.StrainRate(ANY, 5 * dt, release=release_at(20 * dt))
        yield from both(free, dt, t_end, adaptive, about, **bounds, **cut)
        half = rf.Scene(domain, SVK(E=1e9, nu=0.3, rho=1.0), [spin, rf.Rigid("left")])
        yield Run(f"{about}, half rigid", half, dt, t_end, **bounds, **cut)


@case("time", "Δt is more than a hundred times the period of the highest mode")
def steps_far_above_the_highest_period(short: bool) -> Iterator[Run]:
    """H, L and J to Newton's tolerance and to rounding in the strains of a stiff body."""
    E, rho, h = 2.1e11, 7850.0, 0.1  # Pa, kg/m³, m
    dt = 100 * np.pi * h / np.sqrt(E / rho)  # s; no mode of such cells is slower than π h/c
    scene = rf.Scene(
        rf.box((0, 0, 0), (10 * h, 2 * h, 2 * h), (10, 2, 2)),
        SVK(E=E, nu=0.3, rho=rho),
        [rf.InitialVelocity(angular=(1.0, 2.0, 10.0))],
    )
    t_end = dt * (100 if short else 2000)
    yield from both(scene, dt, t_end, rf.StrainRate(ANY, 20 * dt))


@case("time", "a blow that lasts one step and strains the struck end by a tenth")
def shock_within_one_step(short: bool) -> Iterator[Run]:
    """H less the work of the load, to Newton's tolerance; a step end is set at the blow's ends.

    The step of the blow may have to be cut: its end is far from any first guess.
    """
    E, rho = 1e6, 1000.0
    dt = 0.02  # s; the wave runs through a third of a cell
    blow = rf.Traction("x0", (0.2 * E, 0.05 * E, 0.0), since=0.05, until=0.05 + dt)
    scene = rf.Scene(
        rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1) if short else (16, 4, 4)),
        rf.NeoHooke(E=E, nu=0.3, rho=rho),
        [blow],
    )
    t_end = 1.0 if short else 5.0
    yield Run("flexible", scene, dt, t_end, momentum=None, tangents=12, cuts=2)
    adaptive = rf.StrainRate(ANY, 0.04, release=release_at(0.5))
    yield Run("adaptive", scene, dt, t_end, adaptive, momentum=None)


@case("time", "a load that points the other way in every step")
def load_that_reverses_every_step(short: bool) -> Iterator[Run]:
    """H less the work of the load; bodies that each step would release must not come and go.

    A body is found once per window at most, and the windows grow: of n windows some log₂ n end in
    a freeze.
    """
    dt, n = 0.05, (80 if short else 1000)

    def sign(t: float) -> float:
        return 1.0 if int(np.floor(t / dt + 1e-6)) % 2 == 0 else -1.0

    scene = rf.Scene(
        rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)),
        SVK(E=1e5, nu=0.3, rho=100.0),
        [rf.Fixed("x0"), rf.Traction("x1", (0.0, 0.0, 50.0), time=sign)],
    )

    yield Run("flexible", scene, dt, n * dt, momentum=None)
    rule = rf.StrainRate(ANY, 2 * dt, wake="all")
    yield Run("adaptive", scene, dt, n * dt, rule, momentum=None,
              check=few_freezes, warns="again and again")  # fmt: skip


def _arch(cells: int, rise: float) -> rf.Domain:
    """A shallow arch of 10 m span, 1 m wide and 0.2 m thick, clamped at x0 and x1."""

    def place(x: np.ndarray) -> np.ndarray:
        s = 2 * x[0] - 1
        normal = np.stack([2 * rise * s / 5, np.ones_like(s)])
        out = 0.2 * (x[2] - 0.5) * normal / np.linalg.norm(normal, axis=0)
        return np.stack([5 * s + out[0], x[1], rise * (1 - s**2) + out[1]])

    return block_of((cells, 1, 1), place).with_edges("crown", lambda x: np.abs(x[0]) < 1e-9)


@case("time", "an arch that snaps through: its stiffness is indefinite on the way")
def snap_through(short: bool) -> Iterator[Run]:
    """H less the work of the load; the arch ends up on the other side, damped and rigid there."""
    rise, load, cells = 1.0, 5e5, 8 if short else 16  # m, N

    def snaps(history: History) -> str:
        low = history.probe("crown")[:, 2].min()
        return "" if low < -1.5 * rise else f"the crown came down by {-low:.3g} m only"

    def scene(*effects: rf.effects.Effect) -> rf.Scene:
        return rf.Scene(
            _arch(cells, rise),
            SVK(E=2e8, nu=0.3, rho=2000.0),
            [
                rf.Fixed("x0"),
                rf.Fixed("x1"),
                rf.NodalForce("crown", (0.0, 0.0, -load), time=rf.Table((0.0, 0.5), (0.0, 1.0))),
                *effects,
            ],
            order=2,
            probes={"crown": (0.0, 0.5, rise + 0.1)},
        )

    t_end = 1.5 if short else 5.0
    options = {"momentum": None, "tangents": 12, "check": snaps}
    yield Run("flexible", scene(), 0.02, t_end, **options)
    damped = scene(rf.NumericalDamping(0.3))
    calm = rf.StrainRate(0.05, 0.1, wake="all")  # with shapes an arch that is so bent wakes by ν

    def freezes(history: History) -> str:
        rigid = history.cells[-1] >= 0.5 * cells
        return snaps(history) or ("" if rigid else f"only {history.cells[-1]} cells are rigid")

    options["check"] = freezes
    yield Run("adaptive, damped", damped, 0.02, 5.0, calm, **options)


@case("time", "Δt follows an error: a blow on a beam at rest, half soft, half stiff")
def controlled_steps(short: bool) -> Iterator[Run]:
    """Energy to Newton's tolerance, whatever Δt does; steps that err by too much are repeated.

    The blow is declared, and steps of the rest before it are fifty times as long as those in it.
    """
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)).with_cells("soft", lambda x: x[0] <= 2 + 1e-9)
    domain = domain.with_cells("stiff", lambda x: x[0] >= 2 - 1e-9)
    materials = {"soft": SVK(E=1e5, nu=0.3, rho=1e3), "stiff": SVK(E=1e9, nu=0.3, rho=1e3)}
    blow = rf.Traction("x1", (0.0, 0.0, 2e3), since=1.0, until=1.02)
    scene = rf.Scene(domain, materials, [rf.Fixed("x0"), blow], probes={"tip": (4, 0.5, 0.5)})
    t_end = 4.0 if short else 20.0
    cuts = 20 if short else 100
    for tol in (0.3, 0.05):
        control = rf.StepControl(tol, "tip", largest=0.5)
        yield Run(f"{tol:.0%}", scene, control, t_end, momentum=None, cuts=cuts)
    asked = rf.Accuracy(0.1, "tip", min_cells=1)
    yield Run("10% of all", scene, 0.5, t_end, asked, momentum=None, cuts=cuts)


@case("time", "a patch inside a surface is struck at no breakpoint, as viscosity takes one motion")
def struck_inside(short: bool) -> Iterator[Run]:
    """A bar that bends as an axial vibration dies out; what it errs by is within what is asked.

    The patch has none of the ends of its surface, where functions of place were asked only; and
    errors of bending were forgotten as the axial motion is.
    """

    def patch(x: np.ndarray, t: float) -> np.ndarray:
        struck = (np.abs(x[0] - 5) < 1.1) * (0.71 < t < 1.02)
        return np.array([[0], [0], [100.0]]) * struck

    def start(x: np.ndarray) -> np.ndarray:
        return np.stack([0.02 * x[0], 0 * x[0], 0.005 * x[0] ** 2])

    def kept(history: History) -> str:
        ledger = history.last.ledger
        off = ledger.measured.relative
        told = ledger.time.relative + ledger.rigidity.relative
        fits = 0.25 * off < told < 5 * off
        return "" if off < 0.05 and fits else f"off by {off:.3g}, of which {told:.3g} was told"

    scene = rf.Scene(
        rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1)),
        SVK(E=1e6, nu=0.3, rho=1e3),
        [
            rf.Fixed("x0"),
            rf.Traction("z1", patch),
            rf.InitialVelocity(function=start),
            rf.StiffnessDamping(ratio=0.1, frequency=1.0),
        ],
        probes={"tip": (8, 0.5, 0.5)},
    )
    asked = rf.Accuracy(0.05, "tip", check=True)
    options = {"momentum": None, "cuts": 20, "freezes": False, "check": kept}
    yield Run("5% of all", scene, 0.3, 6.0 if short else 40.0, asked, **options)
