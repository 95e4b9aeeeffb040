"""The equations of one division of the cells, bound once: for steps, for statics, for vibrations.

All three have the same unknowns, masses, effects and joints. They differ in the forms of cells and
in whether masses resist. Effects and joints are bound apart from the division, as a state whose
loads are not in balance takes others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from rigidfx.coupling.dealt_rows import Dealing
from rigidfx.coupling.dof_layout import dof_layout
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects import (
    Effect,
    Joint,
    JointSpring,
    Motor,
    PointMass,
    Stop,
    Structure,
    Support,
    Windowed,
)
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.joints.remote import Points
from rigidfx.flexible.internal_forces import BoundForces, InternalForces
from rigidfx.flexible.linear_forms import static_forces
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.actions import Actions, OwnMethods, bound
from rigidfx.step.equations.constraints import Constraints
from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.equations.shape_damping import ShapeDamping
from rigidfx.step.system.division import Division
from rigidfx.step.system.supports import PrescribedDofs
from rigidfx.step.watches.jumps import Jumps

Kind = Literal["step", "static", "linear"]


class Equations:
    """The unknowns, masses, effects and joints of one division; `destroy` frees them.

    Attributes:
        kind: Which equations they are.
        prescribed: Dofs that supports hold.
        layout: Division of cells and dofs.
        mass: Mass operator of the flexible cells.
        structure: The division as effects see it.
        prolongation: Map between unknowns and dofs.
        actions: Actions on nodes and bodies.
        linkage: The joints; None if there are none.
        equilibrium: The balance of forces.
    """

    actions: Actions
    linkage: Linkage | None
    equilibrium: Equilibrium

    def __init__(
        self,
        kind: Kind,
        scene: Scene,
        forces: InternalForces,
        state: State,
        division: Division,
        supports: tuple[Support, ...],
        *,
        jumps: Jumps | None = None,
        notes: dict[int, Any] | None = None,
        dealing: Dealing | None = None,
    ) -> None:
        """Number the unknowns and assemble the mass. Collective.

        Args:
            kind: Steps, statics, or small vibrations about a state.
            scene: The problem.
            forces: Compiled internal forces, which know the loads on facets that act.
            state: Where the structure is.
            division: Division of the cells.
            supports: The supports that act.
            jumps: Observer of the paths of supports, if any.
            notes: Memory of effects; see `Structure`.
            dealing: Deals flexible cells out among the ranks where that pays.
        """
        flexible, bodies, driven = division.flexible, division.bodies, division.driven_cells
        self.kind, self._scene, self._forces, self._driven = kind, scene, forces, driven
        known = division.driven_nodes, jumps, division.nodes_of_held
        self.prescribed = PrescribedDofs(scene, supports, *known)
        self.layout = layout = dof_layout(scene, flexible, bodies.of, self.prescribed.mask, driven)
        own = layout.massive[layout.rows.nodes]
        self.mass = Mass(scene, layout.rows, flexible, own, driven)
        self.structure = Structure(
            scene=scene,
            rows=layout.rows,
            own=own,
            bodies=bodies,
            mass=self.mass,
            u=state.u.x.array,
            surface=forces.surface,
            notes=notes,
            static=kind != "step",
        )
        self._dealt = (
            None if dealing is None else dealing.rows(layout, forces.loaded(flexible, driven or {}))
        )
        self.prolongation = Prolongation(layout, scene.comm, self._dealt)

    def bind(
        self,
        effects: Sequence[Effect],
        acting: Sequence[Windowed],
        *,
        joints: bool = True,
        loose: bool = False,
        damping: ShapeDamping | None = None,
    ) -> None:
        """Bind effects and joints. Collective.

        Args:
            effects: All effects that take part.
            acting: Those with a time window that act.
            joints: Whether joints take part.
            loose: Whether a drag holds parts in statics, in place of springs that joints get.
            damping: That of the shapes of bodies.
        """
        self.actions = Actions(self.structure, effects, acting)
        self.linkage = linked(self.structure, acting) if joints else None
        mass, p = self.mass if self.kind == "step" else None, self.prolongation
        rows: Constraints | None = None
        if self.linkage is not None:
            anchored = self.kind == "static" and not loose
            rows = Constraints(self.linkage, self.structure.bodies, p, anchored)
        given = self._scene, self._forces, self._cells(acting), mass, p, self.actions
        self.equilibrium = Equilibrium(*given, damping, rows)

    def _cells(self, acting: Sequence[Windowed]) -> BoundForces:
        """The forces of flexible cells. Collective."""
        layout = self.layout
        parts = layout.flexible, layout.interior, layout.interface
        if self.kind == "step":
            dealt = None if self._dealt is None else self._dealt.cells
            return self._forces.bind(*parts, self._driven, dealt)
        loads = acting if self.kind == "static" else ()
        return static_forces(self._scene, self._forces, *parts, self._driven, loads)

    def unbind(self) -> None:
        """Free what `bind` has made. Collective."""
        self.equilibrium.destroy()
        self.actions.destroy()

    def destroy(self) -> None:
        """Free all PETSc objects. Collective."""
        self.unbind()
        self.mass.destroy()
        if self._dealt is not None:
            self._dealt.destroy()


def elements_of(scene: Any, acting: Sequence[Windowed]) -> tuple[Motor | JointSpring | Stop, ...]:
    """Actions along free coordinates of joints: motors that act, springs and stops."""
    here = {id(effect) for effect in acting}
    motors = [motor for motor in scene.named(Motor) if id(motor) in here]
    return (*motors, *scene.named(JointSpring), *scene.named(Stop))


def linked(structure: Structure, acting: Sequence[Windowed]) -> Linkage | None:
    """Joints, remote points and springs between points, bound; None without any. Collective."""
    scene = structure.scene
    joints = (*scene.named(Joint), *(e for e in scene.named(PointMass) if e.is_carried))
    points = _points_of(structure, acting)
    if not joints and not len(points):
        return None
    return Linkage(joints, elements_of(scene, acting), structure, points)


def _points_of(structure: Structure, acting: Sequence[Windowed]) -> Points:
    """Actions on points that depend on the motion. Collective."""
    here = {id(effect) for effect in acting}
    every = structure.scene.effects
    wanted = [e for e in every if not e.is_windowed or id(e) in here]
    pairs = [(e, bound(e, structure, "bind_points")) for e in wanted]
    owners = {id(action): effect.owner for effect, action in pairs if action is not None}
    actions = [action for _, action in pairs if action is not None]
    return Points(actions, OwnMethods(owners, structure.scene.comm).call)
