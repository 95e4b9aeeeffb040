"""Mechanisms of rigid bars of given mass between pins."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from common import boxes

import rigidfx as rf

Array = npt.NDArray[np.float64]
Z = 0.0, 0.0, 1.0
DOWN = rf.Gravity((0.0, -9.81, 0.0))
SLENDER = 1e-3  # kg m², of thin bars about their own axes; no number of a plane motion has it


@dataclass(frozen=True)
class Link:
    """A bar along one axis."""

    name: str  # its name
    start: Sequence[float]  # one end [m]
    end: Sequence[float]  # the other end [m]
    cells: int = 1  # number of cells along it
    wide: float = 0.02  # half of its width [m]
    gap: float = 0.1  # part of its length that is left free at each end

    @property
    def corners(self) -> tuple[Array, Array]:
        """Lowest and highest corner [m]."""
        a, b = np.asarray(self.start, float), np.asarray(self.end, float)
        ends = np.stack([a + self.gap * (b - a), b - self.gap * (b - a)])
        across = self.wide * (np.abs(b - a) < 1e-12)
        return ends.min(axis=0) - across, ends.max(axis=0) + across

    @property
    def middle(self) -> Array:
        """Its middle [m]."""
        return 0.5 * (np.asarray(self.start, float) + np.asarray(self.end, float))

    def thin(self, mass: float) -> rf.Rigid:
        """The bar as a rigid one of uniform mass [kg]."""
        d = np.asarray(self.end, float) - np.asarray(self.start, float)
        n, inertia = np.abs(d) / np.linalg.norm(d), mass * float(d @ d) / 12
        return rf.Rigid(self.name, mass=mass, inertia=np.diag(np.where(n > 0.5, SLENDER, inertia)))


def linked(links: Sequence[Link]) -> rf.Domain:
    """A mesh of bars that share no nodes; each has its name. Collective."""
    counts = []
    for link in links:
        along = int(np.argmax(np.subtract(*link.corners[::-1])))
        counts.append([link.cells if axis == along else 1 for axis in range(3)])
    domain = boxes(*((*link.corners, n) for link, n in zip(links, counts, strict=True)))
    for link in links:
        low, high = (corner[:, None] for corner in link.corners)

        def inside(x: Array, low: Array = low, high: Array = high) -> Array:
            return np.asarray(((x >= low - 1e-6) & (x <= high + 1e-6)).all(axis=0))

        domain = domain.with_cells(link.name, inside)
    return domain


SOFT = rf.StVenantKirchhoff(rho=1000.0, E=1e9, nu=0.3)


def four_bars(n: int) -> rf.Scene:
    """n four-bar linkages side by side, IFToMM's benchmark A02."""
    up = [Link(f"up {i}", (i, 0, 0), (i, 1, 0)) for i in range(n + 1)]
    across = [Link(f"across {i}", (i, 1, 0), (i + 1, 1, 0)) for i in range(n)]
    pins = [rf.Revolute("ground", f"up {i}", (i, 0, 0), Z, name=f"A{i}") for i in range(n + 1)]
    for i in range(n):
        pins.append(rf.Revolute(f"up {i}", f"across {i}", (i, 1, 0), Z, name=f"B{i}"))
        pins.append(rf.Revolute(f"across {i}", f"up {i + 1}", (i + 1, 1, 0), Z, name=f"C{i}"))

    def turning(x: Array) -> Array:
        aside = x[0] - np.round(x[0])
        upright = np.abs(aside) < 0.06
        return np.stack([np.where(upright, x[1], 1.0), np.where(upright, -aside, 0.0), 0 * x[0]])

    links = [*up, *across]
    rigid = [link.thin(1.0) for link in links]
    start = rf.InitialVelocity(function=turning)
    return rf.Scene(linked(links), SOFT, [*rigid, *pins, DOWN, start])


def hinged(n: int, springs: bool = False) -> rf.Scene:
    """n thin bars of 1 m and 1 kg on hinges, one after the other, let go from the horizontal."""
    links = [Link(f"bar {i}", (i, 0, 0), (i + 1, 0, 0)) for i in range(n)]
    sides = ["ground", *(link.name for link in links)]
    pins = [rf.Revolute(sides[i], sides[i + 1], (i, 0, 0), Z, name=f"hinge {i}") for i in range(n)]
    more = [rf.JointSpring(f"hinge {i}", 20.0, damping=0.2) for i in range(1, n if springs else 1)]
    bars = [link.thin(1.0) for link in links]
    return rf.Scene(linked(links), SOFT, [*bars, *pins, *more, DOWN])


def with_motor(scene: rf.Scene, hinge: str) -> rf.Scene:
    """The scene at rest, a hinge of which is brought to 2 rad/s in half a second."""
    effects = [e for e in scene.effects if not isinstance(e, rf.InitialVelocity)]
    motor = rf.Motor(hinge, speed=lambda t: 4.0 * min(t, 0.5))
    return rf.Scene(scene.domain, SOFT, [*effects, motor])


def bricard() -> rf.Scene:
    """Bricard's mechanism, five bars along the edges of a cube, IFToMM's benchmark A04."""
    corners = [(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)]
    links = [Link(f"bar {i}", corners[i], corners[i + 1]) for i in range(5)]
    axes = [(0, 1, 0), (0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0)]
    sides = ["ground", *(link.name for link in links), "ground"]
    pins = [
        rf.Revolute(sides[i], sides[i + 1], corners[i], axes[i], name=f"pin {i}") for i in range(6)
    ]
    return rf.Scene(linked(links), SOFT, [*(link.thin(1.0) for link in links), *pins, DOWN])


def heavy_top() -> rf.Scene:
    """A heavy top at 150 rad/s (O. Brüls, A. Cardona, M. Arnold, MMT 48 (2012) 121)."""
    top = Link("top", (0, 0.5, 0), (0, 1.5, 0))
    inertia = np.diag([0.234375, 0.46875, 0.234375])
    effects = [
        rf.Rigid("top", mass=15.0, inertia=inertia),
        rf.Spherical("ground", "top", (0, 0, 0), name="foot"),
        rf.Gravity((0.0, 0.0, -9.81)),
        rf.InitialVelocity(angular=(0.0, 150.0, -4.61538), centre=(0, 0, 0)),
    ]
    return rf.Scene(linked([top]), SOFT, effects)
