"""Contact: what falls deep in one step, a corner first, between walls, stuck and torn loose."""

from collections.abc import Iterator

import numpy as np

import rigidfx as rf

from .case import ANY, History, Run, case

SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
FLOOR = rf.Plane((0, 0, 0), (0, 0, 1))


def _block(*effects: rf.effects.Effect, above: float = 0.02) -> rf.Scene:
    domain = rf.box((0, 0, above), (0.4, 0.2, above + 0.2), (4, 2, 2))
    domain = domain.with_facets("skin", lambda x: np.full(x.shape[1], True))
    return rf.Scene(domain, SOFT, effects, mass="consistent")


@case("contact", "a penalty of a thousand layers of cells, and steps that a wave passes forty of")
def stiff_contact_in_long_steps(short: bool) -> Iterator[Run]:
    """H to Newton's tolerance at any stiffness and any step; momentum changes by the forces."""
    options = {"energy": 1e-10, "momentum": None, "cuts": 20, "tangents": 25}
    thrown = rf.InitialVelocity(linear=(0.3, 0.0, -1.0), angular=(1.0, 2.0, 0.5))
    for factor in (1e-3, 1.0, 1e3):
        contact = rf.Contact("skin", against=FLOOR, stiffness=factor * 1.35e7)
        for dt in (2e-3, 0.1):
            scene, t_end = _block(contact, thrown), (20 if short else 200) * dt
            way = f"{factor:g} layers, Δt = {dt:g} s"
            yield Run(f"{way}, flexible", scene, dt, t_end, **options)
            if not short:
                adaptive = rf.StrainRate(ANY, 5 * dt)
                yield Run(f"{way}, adaptive", scene, dt, t_end, adaptive, **options)


@case("contact", "a tumbling block between the walls of a tube, which grips it")
def rattle_in_a_tube(short: bool) -> Iterator[Run]:
    """H and what friction has taken to Newton's tolerance; friction never gives anything back."""
    tube = rf.Cylinder((0.2, 0.1, 0.1), 0.25, axis=(0.0, 1.0, 0.0), inside=True)
    contact = rf.Contact("skin", against=tube, friction=0.3, creep=1e-3)
    thrown = rf.InitialVelocity(linear=(0.7, 0.2, -1.0), angular=(1.0, 9.0, 0.5))

    def slows(history: History) -> str:
        H = np.array(history.energy)
        return "" if np.all(np.diff(H) <= 1e-10 * H[0]) and H[-1] < 0.99 * H[0] else "H rises"

    options = {"energy": 1e-10, "momentum": None, "cuts": 20, "tangents": 25, "check": slows}
    steps = 60 if short else 1000
    for rigid in ([], [rf.Rigid()]):
        way = "rigid" if rigid else "flexible"
        yield Run(way, _block(contact, thrown, *rigid, above=0.0), 2e-3, steps * 2e-3, **options)


@case("contact", "a squashed ring, slit at one end, that meets itself")
def ring_meets_itself(short: bool) -> Iterator[Run]:
    """H, L and J to Newton's tolerance; a thin wall does not meet its other side."""
    for t, longest in ((0.06, 400), (0.015, 50)):  # the thin one is crushed after that
        for rigid in ([], [rf.Rigid("upper")]):
            way = f"{t:g} m thick, {'upper half rigid' if rigid else 'flexible'}"
            scene, steps = _ring(t, *rigid), 40 if short else longest
            yield Run(way, scene, 1e-3, steps * 1e-3, energy=1e-10, cuts=20, tangents=25)


def _ring(t: float, *effects: rf.effects.Effect) -> rf.Scene:
    box = rf.box((0.1, 0.0, 0.4 - t), (2 * np.pi - 0.1, 0.1, 0.4), (24, 1, 1))  # angle, y, radius
    angle, y, r = box.mesh.geometry.x.T.copy()
    box.mesh.geometry.x[:] = np.c_[r * np.cos(angle), y, r * np.sin(angle)]
    ring = box.with_facets("skin", lambda x: np.full(x.shape[1], True))
    ring = ring.with_cells("upper", lambda x: x[2] > 0.2)

    def thrown(x: np.ndarray) -> np.ndarray:
        return np.stack([0 * x[0] + 0.3, 0.2 * x[2], -20 * x[2]])

    skin = rf.Contact("skin", against="skin")
    effects = skin, rf.InitialVelocity(function=thrown), *effects
    return rf.Scene(ring, SOFT, effects, element="enhanced")
