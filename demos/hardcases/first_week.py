"""Scenes that people try in their first week: right, or told where they answer another question."""

import re
from collections.abc import Iterator
from functools import partial

import numpy as np
from common import on_first_rank, ring

import rigidfx as rf

from .case import History, Run, between, case, near

STEEL = rf.StVenantKirchhoff(E=2.1e11, nu=0.3, rho=7850.0)
SOFT = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
G = 9.81  # m/s²
ECCENTRICITY = 0.025  # m
IMPULSE = 8.23  # N s, with steps of 4e-6 s
SOFT_STOP = 2e9  # N/m³


def drum(n: int) -> rf.Domain:
    """A ring of n flat facets that lies on one of them; radii 0.6 m and 1 m, 0.5 m wide."""
    lying = ring(n, 0.6, 1.0, 0.5, np.pi / n - np.pi / 2)
    return lying.with_facets("skin", lambda x: np.hypot(x[0], x[1]) > 0.9)


def _on_a_slope(n: int, degrees: float) -> rf.Scene:
    """The drum on a slope; gravity is turned in place of the floor."""
    slope = np.radians(degrees)
    down = rf.Gravity((G * np.sin(slope), -G * np.cos(slope), 0.0))
    floor = rf.Plane((0.0, -np.cos(np.pi / n), 0.0), (0.0, 1.0, 0.0))
    contact = rf.Contact("skin", against=floor, friction=0.5, creep=1e-3)
    effects = [rf.Rigid(), contact, down]
    return rf.Scene(drum(n), SOFT, effects, mass="consistent")


@case("first week", "a round surface of flat facets, of which contact knows the nodes")
def drum_of_flat_facets(short: bool) -> Iterator[Run]:
    """A drum of 24 facets stands still at 5° and 7°, and a warning says so before it runs.

    A hollow cylinder has the speed g sin α t/(1 + ½ (1 + 0.36)): 96 facets come within 2 % of it at
    20°, of which nothing is said; 24 are some tenth too slow.
    """
    t_end, told = 0.2 if short else 1.0, "stands still on slopes below 180°/n = 7.5°"
    # Number of facets, slope, the least and the greatest speed, relative, and the words.
    rows = ((24, 5.0, -0.1, 0.1, told),) if short else (
        (24, 5.0, -0.05, 0.05, told), (24, 7.0, -0.05, 0.05, told),
        (24, 20.0, 0.8, 0.98, told), (96, 20.0, 0.98, 1.02, ""))  # fmt: skip
    for n, degrees, low, high, words in rows:
        speed = G * np.sin(np.radians(degrees)) * t_end / 1.68
        mass = 1000.0 * 0.5 * 0.64 * 0.5 * n * np.sin(2 * np.pi / n)

        def rolls(history: History, scale: float = mass * speed, low=low, high=high) -> str:
            found = history.L[-1][0] / scale
            silent = high > 1 and any("facets" in text for text in history.warnings)
            off = not low < found < high or silent
            return f"it has {found:.3f} of a cylinder's speed" if off else ""

        scene = partial(_on_a_slope, n, degrees)
        yield Run(f"{n} facets, {degrees:g}°", scene, 4e-3, t_end, momentum=None, tangents=25,
                  cuts=20, check=rolls, warns=words)  # fmt: skip


def _arm(stiffness: float | None) -> rf.Scene:
    """A steel arm that swings into a stop, which is as stiff as its own cells if None."""
    arm = rf.box((0, 0, 0), (1, 0.05, 0.05), (10, 1, 1))
    arm = arm.with_facets("low", lambda x: (x[2] < 1e-9) & (x[0] > 0.5))
    stop = rf.Plane((0, 0, -1e-3), (0, 0, 1))
    contact = rf.Contact("low", against=stop, stiffness=stiffness)
    swing = rf.InitialVelocity(angular=(0.0, 2.0, 0.0))
    return rf.Scene(arm, STEEL, [contact, swing], element="enhanced")


@case("first week", "an impact that Δt does not resolve")
def arm_that_meets_a_stop(short: bool) -> Iterator[Run]:
    """The impulse is 8.23 N s within 5 % at any Δt; the peak of the force is a mean over a step.

    A warning says so, with a Δt that resolves it. Where a softer stop spreads the blow over more
    steps nothing is said, and the peaks at both Δt agree within 2 %.
    """
    told = "With Δt ≤"
    for dt in (2e-4, 1e-4):
        yield Run(f"stiff, Δt = {dt:g} s", partial(_arm, None), dt, 6e-3, momentum=None,
                  tangents=25, cuts=20, warns=told, check=_impulse)  # fmt: skip
    peaks: list[float] = []

    def agree(history: History) -> str:
        if any("opened again" in text for text in history.warnings):
            return "it is warned of"
        peaks.append(float(np.max(np.diff([L[2] for L in history.L]) / np.diff(history.t))))
        return near("the peak of the force", peaks[-1], peaks[0], 0.02)

    for dt in (2e-4, 1e-4):
        yield Run(f"soft, Δt = {dt:g} s", partial(_arm, SOFT_STOP), dt, 15e-3, momentum=None,
                  tangents=25, cuts=20, check=agree)  # fmt: skip


def _impulse(history: History) -> str:
    """Whether the momentum that the stop has given is right."""
    return near("the impulse", history.L[-1][2] - history.L[0][2], IMPULSE, 0.05)


LEG, ARM, THICK, FILLET = 0.06, 0.3, 0.02, 0.01  # m


def bracket(leg: int, arc: int, arm: int, across: int) -> rf.Domain:
    """A leg and an arm of square section that meet in a fillet of FILLET; cells of each part.

    The leg stands on z = 0, the arm has its lower face at z = LEG; `arc` is of half of the fillet.
    """
    n = leg + 2 * arc + arm
    k = np.repeat(np.arange(n + 1), across + 1)
    s = np.tile(np.linspace(0, 1, across + 1), n + 1)
    angle = np.interp(k, [leg, leg + 2 * arc], [0, np.pi / 2])
    up = np.interp(k, [0, leg], [0, LEG - FILLET])
    along = np.interp(k, [leg + 2 * arc, n], [0, ARM - FILLET])
    inner = THICK + FILLET * (1 - np.cos(angle)) + along, up + FILLET * np.sin(angle)
    outer = (
        np.interp(k, [leg + arc, leg + 2 * arc, n], [0, THICK + FILLET, THICK + ARM]),
        np.interp(k, [0, leg, leg + arc], [0, LEG - FILLET, LEG + THICK]),
    )
    x, z = ((1 - s) * a + s * b for a, b in zip(inner, outer, strict=True))
    points = np.concatenate([np.c_[x, y + 0 * x, z] for y in (0.0, THICK)])
    first = np.arange(n)[:, None] * (across + 1) + np.arange(across)
    sides = [first, first + across + 1, first + 1, first + across + 2]
    face = np.stack([side.reshape(-1) for side in sides], axis=1)
    cells = np.concatenate([face, face + k.size], axis=1)
    pad = between(LEG, LEG, axis=2)
    bent = on_first_rank(points, cells).with_facets("foot", between(0.0, 0.0, axis=2))
    return bent.with_facets("pad", lambda x: pad(x) & (x[0] > THICK + 0.75 * ARM))


def swinging_bracket(*cells: int) -> rf.Scene:
    """The arm swings at a rubber stop; the probe "fillet" is in the middle of the arc."""
    swing = np.array([[0.0], [0.0], [-1.0 / ARM]])  # 1/s
    half = FILLET * np.sqrt(0.5)
    middle = (THICK + FILLET - half, THICK / 2, LEG - FILLET + half)
    stop = rf.Plane((0.0, 0.0, LEG - 2e-4), (0.0, 0.0, 1.0))
    effects = [
        rf.Fixed("foot"),
        rf.InitialVelocity(function=lambda x: swing * np.maximum(x[0] - THICK - FILLET, 0.0)),
        rf.Contact("pad", against=stop, stiffness=1e11),
    ]
    probes = {"fillet": middle}
    return rf.Scene(bracket(*cells), STEEL, effects, element="enhanced", probes=probes)


@case("first week", "the stress in a fillet, of an impact that Δt does not resolve")
def fillet_of_an_arm_that_meets_a_stop(short: bool) -> Iterator[Run]:
    """A warning names a Δt; the first peaks of stress and force are within 3 % of half of it.

    With the steps that are warned of, the force is a half or three quarters of that.
    """
    scene = swinging_bracket(*((2, 1, 4, 2) if short else (6, 3, 16, 3)))
    told: list[float] = []
    peaks: list[tuple[float, float]] = []

    def coarse(history: History) -> str:
        peaks.append((max(history.pressing), max(history.stress)))
        found = (re.search(r"With Δt ≤ (\S+) s", text) for text in history.warnings)
        told.extend(float(match[1]) for match in found if match)
        return ""

    def resolved(history: History) -> str:
        if any("opened again" in text for text in history.warnings):
            return "it is warned of"
        force, stress = max(history.pressing), max(history.stress)
        if len(peaks) > 2:
            other = near("the force", force, peaks[2][0], 0.03)
            return other or near("the stress", stress, peaks[2][1], 0.03)
        peaks.append((force, stress))
        return "" if peaks[1][0] < 0.8 * force else f"{peaks[1][0]:g} N are {force:g} N"

    how = {"momentum": None, "tangents": 25, "cuts": 20, "stress_at": "fillet"}
    for dt in (2e-4, 1e-4):
        yield Run(f"Δt = {dt:g} s", scene, dt, 1.2e-3, warns="With Δt ≤", check=coarse, **how)
    for k in (1, 2):
        yield Run(f"named / {k}", scene, told[-1] / k, 1.2e-3, check=resolved, **how)


@case("first week", "a shaft out of balance, whose bearings are springs at nodes of their axis")
def whirl_of_a_rotor(short: bool) -> Iterator[Run]:
    """Jeffcott: r/e = s/(1 - s), s = (ω/ω₀)², within 0.2 %; springs do not hold the spin back."""
    for ratio in (0.3304, 1.3216):
        scene, dt, turn = jeffcott(ratio, (4, 2, 1) if short else (4, 4, 5))

        def stays(history: History, radius: float = ratio * ECCENTRICITY) -> str:
            off = np.hypot(*(history.probe("axis")[:, :2]).T) / radius - 1
            return "" if np.abs(off).max() < 2e-3 else f"r is off by {np.abs(off).max():.1e}"

        yield Run(f"r/e = {ratio:g}", scene, dt, (1 if short else 3) * turn, momentum=None,
                  check=stays)  # fmt: skip


def jeffcott(ratio: float, cells: tuple[int, int, int]) -> tuple[rf.Scene, float, float]:
    """A shaft at 50 rad/s that whirls at a ratio r/e about bearings, a Δt, and the time of a turn.

    The axis of the bearings is beside the shaft's centre by the eccentricity.
    """
    omega, e = 50.0, ECCENTRICITY
    shaft = rf.box((-0.05, -0.05, 0), (0.05, 0.05, 0.5), cells)
    for name, z in (("low", 0.0), ("high", 0.5)):
        shaft = shaft.with_vertices(
            name, lambda x, z=z: np.linalg.norm(x.T - (-e, 0, z), axis=1) < 1e-9
        )
    k = STEEL.rho * 0.1 * 0.1 * 0.5 * omega**2 * (1 + ratio) / ratio
    springs = [rf.Spring(name, k / 2) for name in ("low", "high")]
    out = rf.InitialDisplacement(lambda x: np.array([ratio * e, 0, 0])[:, None] + 0 * x)
    spin = rf.InitialVelocity(angular=(0.0, 0.0, omega), centre=(-e, 0.0, 0.0))
    scene = rf.Scene(shaft, STEEL, [*springs, out, spin], probes={"axis": (-e, 0, 0.25)})
    turn = 2 * np.pi / omega
    return scene, turn / 40, turn
