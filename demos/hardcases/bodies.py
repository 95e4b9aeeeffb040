"""Rigid bodies: where and when they may form, and what must not disturb them."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from common import ring
from scipy.special import ellipk

import rigidfx as rf

from .case import ANY, History, between, case, few_freezes, middles, near, release_at
from .case import Run as AnyRun
from .twin import PROMISED

# Newton is as fast as without bodies, and what it leaves does not add up.
Run = partial(AnyRun, energy=1e-11, momentum=1e-11, tangents=4)
SVK = rf.StVenantKirchhoff
SOFT = SVK(E=300.0, nu=0.3, rho=1.0)
SPIN = rf.InitialVelocity(linear=(0.3, 0.2, -0.1), angular=(0.3, 0.2, 0.5))


@case("rigid bodies", "frozen and released in the middle of the flip about the unstable axis")
def intermediate_axis_flip(short: bool) -> Iterator[AnyRun]:
    """H, L and J to Newton's tolerance; the period is that of a free top, 4 K(k²)/τ, within 1 %."""
    a, b, c = 4.0, 2.0, 1.0  # m
    omega = np.array([0.05, 1.0, 0.0])  # rad/s
    # Lumped masses at the corners of cells of 1 m × 1 m × 0.5 m: moments of the body of them.
    second = [float(np.mean((np.arange(n + 1) * h - e / 2) ** 2 * _ends(n)))
              for n, h, e in ((4, 1.0, a), (2, 1.0, b), (2, 0.5, c))]  # fmt: skip
    J = np.array([second[1] + second[2], second[0] + second[2], second[0] + second[1]])
    period = _free_top_period(J, omega)
    scene = rf.Scene(
        rf.box((-a / 2, -b / 2, -c / 2), (a / 2, b / 2, c / 2), (4, 2, 2)),
        SVK(E=2e8, nu=0.3, rho=1000.0),
        [rf.InitialVelocity(angular=tuple(omega))],
        probes={"pole": (0.0, b / 2, 0.0), "middle": (0.0, 0.0, 0.0)},
    )
    t_end = period * (1.1 if short else 5.1)

    def flips(history: History) -> str:
        """The axis b turns over; ω₂ in the body changes sign where J·axis does."""
        above = np.array([0.0, b / 2, 0.0])
        axis = above + history.probe("pole") - history.probe("middle")
        along = axis @ np.array(history.J[0])
        t = np.array(history.t)
        at = np.flatnonzero(along[1:] * along[:-1] < 0)
        crossed = t[at] + (t[at + 1] - t[at]) * along[at] / (along[at] - along[at + 1])
        if len(crossed) < 2:
            return f"it flipped {len(crossed)} times in {t[-1]:.4g} s"
        mean = 2 * float(np.mean(np.diff(crossed)))
        return near("the period", mean, period, 0.01)

    # Some steps are solved again, tightly: no stress tells what a solve leaves of a spin.
    yield Run("flexible", scene, 0.1, t_end, tangents=8, check=flips)
    flip = 0.3 * period
    adaptive = rf.StrainRate(ANY, 1.0, release=release_at(flip), since=flip - 5, until=flip + 5)
    yield Run("adaptive", scene, 0.1, t_end, adaptive, tangents=8, check=flips)


def _ends(n: int) -> np.ndarray:
    """Weights of n + 1 equidistant masses, of which those at the ends are halved; mean 1."""
    weights = np.ones(n + 1)
    weights[[0, -1]] = 0.5
    return weights * (n + 1) / n


def _free_top_period(J: np.ndarray, omega: np.ndarray) -> float:
    """Period of a free top that starts near its intermediate axis [s]."""
    k = np.argsort(J)
    J1, J2, J3 = J[k]
    w1, w2, w3 = omega[k]
    h, m = J1 * w1**2 + J2 * w2**2 + J3 * w3**2, (J1 * w1) ** 2 + (J2 * w2) ** 2 + (J3 * w3) ** 2
    if m > h * J2:  # turns about the axis of the largest moment
        J1, J3 = J3, J1
    k2 = (J2 - J3) * (m - h * J1) / ((J1 - J2) * (h * J3 - m))
    rate = np.sqrt(abs((J1 - J2) * (m - h * J3)) / (J1 * J2 * J3))
    k2 = abs(k2) if abs(k2) < 1 else 1 / abs(k2)
    return float(4 * ellipk(k2) / rate)


def _bar(*effects: rf.effects.Effect, cells=(6, 2, 2), **options) -> rf.Scene:
    """A bar of 6 m × 2 m × 2 m in unit cells, and names for some of them."""
    domain = rf.box((0, 0, 0), (6, 2, 2), cells)
    domain = domain.with_cells("cell", lambda x: x.max(axis=0) <= 1 + 1e-9)
    for name, corner in {"first": (0, 0, 0), "second": (0, 1, 1)}.items():
        low = np.array(corner)[:, None]
        domain = domain.with_cells(
            name, lambda x, low=low: ((x >= low - 1e-9) & (x <= low + 1 + 1e-9)).all(axis=0)
        )
    domain = domain.with_cells("left", between(0, 2)).with_cells("right", between(3, 6))
    return rf.Scene(domain, SOFT, list(effects) or [SPIN], **options)


def _together(domain: rf.Domain, name: str, parts: list[str]) -> rf.Domain:
    cells = [domain.find(part, (3,), "hard cases").entities for part in parts]
    return domain.with_cell_set(name, np.concatenate(cells))


@case("rigid bodies", "bodies of one cell, and of two that touch at an edge only")
def smallest_bodies(short: bool) -> Iterator[AnyRun]:
    """H, L and J to Newton's tolerance. What would be two bodies with a hinge is one of them."""
    t_end = 5.0 if short else 50.0
    one = rf.StrainRate(0.0, 0.5, tolerances={"cell": ANY}, release=release_at(2.0), min_cells=1,
                        patience=1)  # fmt: skip

    def is_found(history: History) -> str:
        return "" if max(history.cells) == 1 else f"{max(history.cells)} rigid cells"

    yield Run("one cell, adaptive", _bar(), 0.1, t_end, one, check=is_found)
    yield Run("one cell, named", _bar(SPIN, rf.Rigid("cell")), 0.1, t_end)
    hinged = rf.StrainRate(0.0, 0.5, tolerances={"first": ANY, "second": ANY}, min_cells=1,
                           patience=1)  # fmt: skip

    yield Run("two cells at an edge, adaptive", _bar(), 0.1, t_end, hinged, check=is_found)
    domain = _together(_bar().domain, "both", ["first", "second"])
    scene = rf.Scene(domain, SOFT, [SPIN, rf.Rigid("both")])
    yield Run("two cells at an edge, named as one", scene, 0.1, t_end)
    two = partial(_bar, SPIN, rf.Rigid("first"), rf.Rigid("second"))
    yield Run("two cells at an edge, named as two", two, 0.1, t_end,
              fails=rf.SceneError, says=("hinge",))  # fmt: skip


@case("rigid bodies", "a body whose nodes lie on a line but for 5e-6 of its length")
def nodes_on_a_line(short: bool) -> Iterator[AnyRun]:
    """Its inertia about that line is rounding: such a body is refused, or not formed."""
    thin = 5e-6
    scene = lambda *rigid: rf.Scene(  # noqa: E731
        rf.box((0, 0, 0), (1, thin, thin), (1, 1, 1)),
        SVK(E=1e6, nu=0.3, rho=1000.0),
        [rf.InitialVelocity(linear=(0.1, 0.2, 0.3)), *rigid],
    )
    yield Run("named", scene(rf.Rigid()), 0.1, 1.0, fails=rf.SceneError, says=("on a line",))

    def stays_flexible(history: History) -> str:
        return "" if max(history.cells) == 0 else "it has become a body"

    yield Run("adaptive", scene(), 0.1, 1.0, rf.StrainRate(ANY, 0.2), energy=1e-9,
              tangents=8, check=stays_flexible, freezes=False)  # fmt: skip


@case("rigid bodies", "every second cell qualifies, as on a checkerboard")
def checkerboard(short: bool) -> Iterator[AnyRun]:
    """Bodies of one cell, none of which has a node of another; H, L, J to Newton's tolerance."""
    n = 4 if short else 6
    domain = rf.box((0, 0, 0), (n, n, 2), (n, n, 2))
    middle = middles(domain)
    black = np.flatnonzero(np.floor(middle).sum(axis=1) % 2 == 0)
    domain = domain.with_cell_set("black", black)
    scene = rf.Scene(domain, SOFT, [SPIN])

    def apart(history: History) -> str:
        """Two cells high, every other one along and across at most."""
        bodies, cells = max(history.bodies), max(history.cells)
        return "" if cells == bodies <= (n // 2) ** 2 else f"{bodies} bodies of {cells} cells"

    criterion = rf.StrainRate(0.0, 0.5, tolerances={"black": ANY}, min_cells=1, patience=1)
    yield Run("adaptive", scene, 0.1, 3.0 if short else 30.0, criterion, check=apart)


@case("rigid bodies", "a closed ring of bodies with one flexible cell between each two")
def ring_of_bodies(short: bool) -> Iterator[AnyRun]:
    """H, L and J to Newton's tolerance: a closed chain constrains nothing twice."""
    n = 12
    domain = ring(n, 3.0, 4.0, 1.0)
    middle = middles(domain)
    sector = np.floor(np.mod(np.arctan2(middle[:, 1], middle[:, 0]), 2 * np.pi) / (2 * np.pi / n))
    names = [f"link {k}" for k in range(n // 3)]
    for k, name in enumerate(names):
        domain = domain.with_cell_set(name, np.flatnonzero(np.isin(sector, (3 * k, 3 * k + 1))))
    t_end = 5.0 if short else 50.0
    scene = rf.Scene(domain, SOFT, [SPIN, *map(rf.Rigid, names)])
    yield Run("named", scene, 0.1, t_end)
    scene = rf.Scene(domain, SOFT, [SPIN])
    criterion = rf.StrainRate(0.0, 0.5, tolerances=dict.fromkeys(names, ANY),
                              release=release_at(2.0), patience=1)  # fmt: skip

    def all_form(history: History) -> str:
        return "" if max(history.bodies) == n // 3 else f"{max(history.bodies)} bodies"

    yield Run("adaptive", scene, 0.1, t_end, criterion, check=all_form)


@case("rigid bodies", "one layer of flexible cells between two big bodies: no free node at all")
def layer_between_two_bodies(short: bool) -> Iterator[AnyRun]:
    """H, L and J to Newton's tolerance: 12 unknowns carry the strain of the layer."""
    t_end = 5.0 if short else 50.0
    scene = _bar(SPIN, rf.Rigid("left"), rf.Rigid("right"), cells=(6, 2, 2))
    yield Run("named", scene, 0.1, t_end)
    criterion = rf.StrainRate(0.0, 0.5, tolerances={"left": ANY, "right": ANY},
                              release=release_at(2.0), patience=1)  # fmt: skip
    yield Run("adaptive", _bar(), 0.1, t_end, criterion)


@case("rigid bodies", "a condition that releases what has just become rigid, each time")
def chatter(short: bool) -> Iterator[AnyRun]:
    """Of n windows some log₂ n end in a freeze: cells wait longer each time; a warning says so."""
    n = 60 if short else 1000
    release = rf.Release(when=lambda report: bool(report.bodies))
    kick = rf.InitialVelocity(function=lambda x: 0.1 * np.sin([7 * x[0], 5 * x[1], x[2]]))

    criterion = rf.StrainRate(ANY, 0.2, release=release)
    yield Run("adaptive", _bar(SPIN, kick), 0.1, 0.1 * n, criterion, check=few_freezes,
              warns="again and again")  # fmt: skip


@case("rigid bodies", "all is rigid while gravity changes all the time")
def all_rigid_under_changing_gravity(short: bool) -> Iterator[AnyRun]:
    """The centre falls as ∫∫ g by the rule of the step: to rounding; H less the work likewise."""
    dt, n = 0.05, (100 if short else 2000)
    weight = rf.Gravity((0.0, 0.0, -9.81), time=lambda t: np.cos(2 * t))
    scene = _bar(SPIN, weight)

    def falls(history: History) -> str:
        assert history.last is not None
        (body,) = history.last.bodies
        t = dt * (np.arange(len(history.iterations)) + 0.5)
        apart = dt / np.sqrt(12)
        mean = 0.5 * (np.cos(2 * (t - apart)) + np.cos(2 * (t + apart)))
        impulse = body.mass * -9.81 * dt * float(mean.sum())
        found = history.last.linear_momentum[2] - history.L[0][2]
        error = abs(found - impulse) / (body.mass * 9.81)
        return "" if error <= 1e-11 else f"L_z is off by {error:.1e} of m g · 1 s"

    stay = rf.StrainRate(ANY, 4 * dt, wake="none")
    yield Run("adaptive", scene, dt, n * dt, stay, momentum=None, check=falls)
    scene = _bar(SPIN, weight, rf.Rigid())
    yield Run("named", scene, dt, n * dt, momentum=None, check=falls)


@case("rigid bodies", "a load that arrives on a part that is frozen")
def load_on_a_frozen_part(short: bool) -> Iterator[AnyRun]:
    """By the paper's rule all is released before the step, and is as without bodies, to 1e-9.

    With shapes the tip is off by no more than 2.4 tol over the peak rate, of its largest way.
    """
    t_end = 3.0 if short else 10.0
    blow, peak = rf.Traction("x1", (0.0, 3.0, 1.0), since=1.0), 0.1276  # 1/s, of the flexible bar

    def scene() -> rf.Scene:
        return _bar(blow, probes={"tip": (6.0, 2.0, 2.0)})

    reference: list[np.ndarray] = []

    def remember(history: History) -> str:
        reference.append(history.probe("tip"))
        return ""

    def is_the_same(history: History, bound: float = 1e-9) -> str:
        if max(history.cells) != 24:
            return "not all was frozen"
        u = history.probe("tip")
        error = float(np.abs(u - reference[0]).max() / np.abs(reference[0]).max())
        return "" if error <= bound else f"the tip is off by {error:.1e}"

    yield Run("flexible", scene(), 0.1, t_end, momentum=None, check=remember)
    criterion = rf.StrainRate(1e-6, 0.5, patience=1, until=2.0, wake="all")
    yield Run("adaptive", scene(), 0.1, t_end, criterion, momentum=None, check=is_the_same)
    for part in (1e-2, 1e-3):
        criterion = rf.StrainRate(part * peak, 0.5, patience=1, until=2.0)
        close = partial(is_the_same, bound=PROMISED * part)
        yield Run(f"shapes, {part:g}", scene(), 0.1, t_end, criterion, momentum=None, check=close,
                  tangents=8)  # fmt: skip


@case(
    "rigid bodies", "a wake where a load begins between two steps, and a support where all is rigid"
)
def wakes_at_breakpoints(short: bool) -> Iterator[AnyRun]:
    """H to Newton's tolerance. Momenta change by what load and support give."""
    push = rf.Traction("x1", (0, 0, 10.0), since=1.03, until=1.51)
    drag = rf.KelvinVoigt(20.0)
    rule = rf.StrainRate(0.05, 0.4)

    def wakes(history: History) -> str:
        woken = [event.t for event in history.events if event.woken.size]
        return "" if any(near("a wake", t, 1.03, 1e-9) == "" for t in woken) else f"wakes: {woken}"

    def is_released(history: History) -> str:
        times = [event.t for event in history.events if event.kind == "release"]
        return near("the release", times[0], 1.07, 1e-9) if times else "it is never released"

    for mass in ("lumped", "consistent"):
        scene = _bar(SPIN, push, drag, mass=mass)
        yield Run(f"load, {mass}", scene, 0.1, 4.0, rule, check=wakes, momentum=None)
        scene = _bar(SPIN, rf.Fixed("x0", since=1.07), drag, mass=mass)
        yield Run(f"support, {mass}", scene, 0.1, 4.0, rule, check=is_released, momentum=None)


@case("rigid bodies", "a root named rigid gives way in truth, and a support holds it")
def held_part_that_gives_way(short: bool) -> Iterator[AnyRun]:
    """`compliance` tells what it takes: what the tip is off by, within a fifth."""
    period = 200.0 if short else 800.0
    push = rf.Traction("x1", (0, 0, 0.01), time=lambda t: np.sin(2 * np.pi * t / period))
    drag, rule = rf.MassDamping(0.2), rf.StrainRate(rf.Relative(0.02), period / 40)
    held = (
        ("clamped", rf.Fixed("x0")),
        ("moved", rf.PrescribedMotion("x0", displacement=lambda t: (0, 1e-3 * t / period, 0))),
    )
    for mass in ("lumped", "consistent"):
        for how, support in held:
            way: list[float] = []

            effects = [push, drag, support]
            still = replace(push, time=None), rf.Fixed("x0"), rf.Rigid("left")
            told = rf.compliance(_bar(*still, mass=mass, probes={"tip": (6.0, 1.0, 1.0)}))
            taken = told.taken["tip"]

            def deflects(history: History, way=way, taken=taken) -> str:
                """Of the flexible run first, then of that with the rigid root."""
                tip = history.probe("tip")
                way.append(float(np.abs(tip[-1] - tip[0])[2]))
                if len(way) == 1:
                    return ""
                return near("what it takes", taken, 1 - way[1] / way[0], 0.2)

            tip = {"tip": (6.0, 1.0, 1.0)}
            common = {"momentum": None, "check": deflects, "tangents": 8}
            scene = _bar(*effects, mass=mass, probes=tip)
            yield Run(f"flexible, {how}, {mass}", scene, period / 200, period / 4, **common)
            scene = _bar(*effects, rf.Rigid("left"), mass=mass, probes=tip)
            yield Run(f"named, {how}, {mass}", scene, period / 200, period / 4, rule,
                      freezes=False, **common)  # fmt: skip


@case("rigid bodies", "released while a load grows, and its shapes vibrate")
def released_with_shapes(short: bool) -> Iterator[AnyRun]:
    """H to Newton's tolerance, as a release gives all back. Momenta change by the load."""
    push = rf.Traction("x1", (0, 0, 10.0), time=lambda t: float(np.clip((t - 1) / 2, 0, 1)) ** 2)
    rule = rf.StrainRate(0.5, 0.4, release=release_at(1.6))

    def had_shapes(history: History) -> str:
        first = next((e.t for e in history.events if e.kind == "release"), 0.0)
        if near("the release", first, 1.6, 1e-9):
            return f"the first release is at {first:.3g} s"
        before = history.unknowns[int(np.searchsorted(history.t, 1.6 - 1e-9)) - 1]
        return "" if before > 6 else "the body has no shapes"

    for mass in ("lumped", "consistent"):
        scene = _bar(SPIN, push, rf.KelvinVoigt(20.0), mass=mass)
        yield Run(mass, scene, 0.1, 4.0 if short else 8.0, rule, momentum=None, check=had_shapes)
