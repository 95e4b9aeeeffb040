"""What a rigid part would give way by in the whole structure, and not beside its neighbours alone.

The difference of two motions, e = ũ - u, obeys the equations of the whole structure under ρ; a
shadow is that structure, cut off behind one layer of cells, without its contacts and springs. For
what a structure is told to lack that is too little to hold it where something else bears the loads.
It is told once, so that it is worth one tangent of all of it as it is then, the part flexible: of
a step so long that neither inertia nor viscosity counts, by the midpoint rule half the stiffness.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from rigidfx.coupling.dof_layout import dof_layout
from rigidfx.coupling.mass import mass_operator
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.flexible.internal_forces import Cells
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.shadow.parts import Parts
from rigidfx.step.equations.actions import Actions
from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.equations.structure import BoundStructure
from rigidfx.step.newton.factors import Factors
from rigidfx.step.stepper import Stepper
from rigidfx.step.system.supports import PrescribedDofs

__all__ = ["Strongest"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

LONG = 1e4  # times the time so far: a step in which nothing but stiffness counts
UP_TO = 100_000  # unknowns that are factored for that: their factors take 2 GB, and ten seconds


class Strongest:
    """The forces by which parts named rigid withheld most so far."""

    def __init__(self) -> None:
        """Nothing is withheld."""
        self._known: dict[str, tuple[float, RigidBody, Array]] = {}

    def note(self, parts: Parts, withheld: Mapping[str, float], force: Array) -> None:
        """Take note of a step.

        Args:
            parts: The bodies.
            withheld: ½ ρᵀK⁺ρ, by the names of parts named rigid that are in them [J].
            force: ρ at the nodes of the rows, shape (nodes, 3) [N].
        """
        for data, at in zip(parts.bodies, parts.at, strict=True):
            for name in data.named:
                if withheld[name] > (self._known[name][0] if name in self._known else 0.0):
                    self._known[name] = withheld[name], data, force[at]

    def share(self, name: str, stepper: Stepper, present: Bodies, dt: float) -> float | None:
        """What part of its energy a part would withhold in the whole structure. Collective.

        Args:
            name: The part.
            stepper: Solves the steps.
            present: Bodies as they are now.
            dt: Length of the last step [s].

        Returns:
            The part; None where nothing is known of it, and where the structure is too large.
        """
        if 3 * stepper.scene.space.dofmap.index_map.size_global > UP_TO:
            return None
        now = {id(body.data): body.motion.R for body in present}
        if name not in self._known or id(self._known[name][1]) not in now:
            return None
        energy, data, force = self._known[name]
        whole = energy_in_whole(stepper, data, force @ now[id(data)].T, dt)
        # What buckles has no stiffness that tells.
        return whole / energy if whole > 0 and np.isfinite(whole) else None


def energy_in_whole(stepper: Stepper, data: RigidBody, force: Array, dt: float) -> float:
    """½ ρᵀK⁻¹ρ, K the stiffness of the structure at present, a part of it flexible. Collective.

    Args:
        stepper: Solves the steps.
        data: The part.
        force: ρ at its nodes, in space, shape (nodes, 3) [N].
        dt: Length of the last step [s].
    """
    scene, state, forces = stepper.scene, stepper.state, stepper.forces
    state.rebuild()
    end = forces.u1.x.array.copy()
    others = Bodies.of_each(body for body in state.bodies if body.data is not data)
    mask = stepper.flexible
    mask[data.cells] = True
    flexible = forces.cells(np.flatnonzero(mask).astype(np.int32))
    driven, prescribed = _driven(stepper, data)
    layout = dof_layout(scene, flexible, others.of, prescribed, driven)
    own = layout.massive[layout.rows.nodes]
    mass = mass_operator(scene, layout.rows, flexible, own, driven)
    structure = BoundStructure(
        scene=scene,
        rows=layout.rows,
        own=own,
        bodies=others,
        mass=mass,
        u=state.u.x.array,
        surface=forces.surface,
        failures=stepper.failures,
        notes=dict(state.notes),
    )
    actions = Actions(structure, scene.effects, stepper.system.acting)
    bound = forces.bind(flexible, layout.interior, layout.interface, driven)
    prolongation = Prolongation(layout, scene.comm)
    whole = Equilibrium(scene, forces, bound, mass, prolongation, actions)
    forces.set_time(state.t, dt)
    actions.set_time(state.t, dt)
    still = layout.rows.vector()
    nothing = np.zeros(prolongation.prescribed.size)
    whole.begin(LONG * state.t, still, nothing, others)
    y = prolongation.unknowns()
    r, f = y.duplicate(), layout.rows.vector()
    whole.residual(y, r)
    whole.tangent()
    f.array.reshape(-1, 3)[layout.rows.positions(data.nodes)] = force
    prolongation.collapse(f.array_r, np.zeros((len(layout.bodies), 6)), r)
    factors = Factors(whole)
    factors.renew()
    factors.solve(r, y)
    out = 0.25 * float(r.dot(y))
    forces.u1.x.array[:] = end
    for item in (factors, y, r, f, still, whole, actions, mass):
        item.destroy()
    return out


def _driven(stepper: Stepper, data: RigidBody) -> tuple[Cells | None, Bools]:
    """Cells that supports still move where a part is flexible, and which dofs these hold."""
    scene, state = stepper.scene, stepper.state
    prescribed = PrescribedDofs(scene, stepper.prescribed.active).mask
    others = [cells for cells in state.clamped.values() if not np.array_equal(cells, data.cells)]
    if not others:
        return None, prescribed
    cells = np.sort(np.concatenate(others))
    nodes = np.unique(scene.space.dofmap.list[cells])
    nodes = nodes[nodes < scene.owned_nodes]
    prescribed[(3 * nodes[:, None] + np.arange(3)).reshape(-1)] = True
    return stepper.forces.cells(cells), prescribed
