"""Actions of effects on nodes and on rigid bodies, and their terms of the compiled forms.

An effect is one item. Its record, which a user writes, says what it is; `bind` makes of it an
`Action`, which adds forces and their derivatives to the equations of a step and reports energies;
`term` makes a `FormTerm` of it where it belongs into the compiled forms. An effect overrides what
it does and inherits the rest, which costs nothing: a step asks no action for what it does not do.

Effects know nothing of the system they are part of but a `Structure`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.types import Array, Bools
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.element import Element


@dataclass(frozen=True, kw_only=True)
class Structure:
    """A division of a scene as effects see it."""

    scene: Any  # the problem: its mesh, names and nodal weights
    rows: Any  # rows of the nodes that take part in a step
    own: Bools  # for each of these nodes, whether it belongs to no body
    bodies: Bodies
    mass: Any  # mass operator of these nodes; None in statics
    u: Array  # displacements of all local dofs at the start of a step [m], changed by each step
    surface: Any = None  # the deformed boundary; None where no effect asks for it
    # Memory of effects from step to step, by their identity; None where bodies are treated as if
    # they were flexible.
    notes: dict[int, Any] | None = None
    static: bool = False  # whether forces are those at the end of a step, and nothing moves
    instant: bool = False  # whether loads are those of an instant

    @property
    def once(self) -> float:
        """1 on the first rank, 0 on others: counts once what all ranks know."""
        return float(self.scene.comm.rank == 0)

    def over(self, dt: float) -> float:
        """Time that loads are means over, in a step of Δt [s]: none in statics."""
        return 0.0 if self.static or self.instant else dt


def _nothing() -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class Touch:
    """Force and impulse of a contact in a step; those of ranks and parts add up.

    Attributes:
        name: Title of the contact.
        force: On the surface at the step's midpoint, shape (3,) [N]; zero where it meets itself.
        moment: Its moment about the origin, likewise [N m].
        pressing: Sum of the sizes of the forces at nodes [N], in the mean of the step.
        resolved: Its mean over the shortest time that the mesh resolves, up to the end of the step;
            in reports of a run only [N].
        energy: Stored in the contact at its end [J].
        work: Work of a moving obstacle on the structure [J].
        dissipated: Energy that friction took [J].
        penetration: Greatest penetration at its end [m].
        nodes: Number of nodes that touch at its end.
    """

    name: str
    force: Array = field(default_factory=_nothing)
    moment: Array = field(default_factory=_nothing)
    pressing: float = 0.0
    resolved: float = 0.0
    energy: float = 0.0
    work: float = 0.0
    dissipated: float = 0.0
    penetration: float = 0.0
    nodes: int = 0

    def __add__(self, other: Touch) -> Touch:
        sums = {key: value + getattr(other, key) for key, value in vars(self).items()}
        deeper = max(self.penetration, other.penetration)
        return Touch(**(sums | {"name": self.name, "penetration": deeper}))


class Action:
    """An effect bound to the dofs and bodies of a division; forces are in N, moments in N m.

    Forces that depend on the motion are written as *resistance*, which is added to the residual.
    Numbers of nodes are this rank's, those of bodies are equal on all ranks.
    """

    kind: str = ""  # name of the effect's class
    title: str = ""  # name in reports
    rounding: float = 0.0  # size of a force that the machine precision is to be multiplied with [N]
    dissipates: bool = True  # whether the energy that it takes is dissipated, not work of a load
    # Whether forces on nodes depend on other nodes. Where bodies are treated as if they were
    # flexible it is asked in the run's division, for forces on all nodes.
    couples: bool = False
    nodes: Any = None  # the nodes that it acts on; `RemoteNodes` if joints move them
    presses: ClassVar[bool] = False  # whether it is a contact: see `ContactForces`

    @classmethod
    def does(cls, method: str) -> bool:
        """Whether actions of its class do something of their own by a method."""
        return getattr(cls, method, None) is not getattr(Action, method, None)

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate functions of time for a step of Δt about t [s]; one that fails raises."""

    def load(self, forces: Any) -> None:
        """Add dead loads to the external forces of a step: asked once in each."""

    def resist(self, motion: Any, forces: Any) -> None:
        """Add the resistance at an iterate, a `Motion`: asked in each iteration. Collective.

        It adds to `Forces` or `ForcesOfNodes`; of a `RemoteMotion` to an array.
        """

    def stiffen(self, motion: Any, tangent: Any) -> None:
        """Add its derivative as far as forces change at the nodes that move. Collective."""

    def stored(self, at: Any) -> float:
        """Energy that it stores, of a contact too; those of ranks add up [J]. Collective."""
        return 0.0

    def taken(self, motion: Any) -> float:
        """Energy that it takes out of the motion in a step; those of ranks add up [J]."""
        return 0.0

    def told(self, motion: Any) -> Any:
        """Its report of a step at remote points, if it has a title."""
        raise NotImplementedError

    def accept(self) -> None:
        """Store what later steps need: the last iterate has become a step."""

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""


class FormTerm:
    """A term of the compiled forms; it exists in them only while its effect acts."""

    kind: str = ""  # name of the effect's class
    boundary: bool = False  # whether an integral over facets, those of `where`, instead of cells
    dissipates: bool = True  # whether its loss in a step is dissipated energy, not work of a load
    viscous: bool = False  # whether it is a stress that grows with 1/Δt

    def of(self, law: Any) -> FormTerm:
        """The term in cells of a `Law`; itself where the stored energy does not matter."""
        return self

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate functions of time for a step: see `Action.set_time`."""

    def set_rate(self, rate: float) -> None:
        """Set 1/Δt of a viscous stress [1/s]."""

    def virtual_work(self, element: Element, u0: Any, u1: Any, w: Any) -> Any:
        """Integrand that is added to the internal virtual work."""
        raise NotImplementedError

    def eliminated(self, element: Element, u0: Any, u1: Any, w: Any, du: Any) -> Any:
        """Loss of its tangent by elimination within a cell; None if nothing."""
        return None

    def taken(self, element: Element, u0: Any, u1: Any) -> Any:
        """Integrand of the energy that it takes out of the motion in a step [J/m³ or J/m²]."""
        return self.virtual_work(element, u0, u1, u1 - u0)
