"""Where nodes are once bodies that were found leave their shapes.

Shapes move nodes by Φq, of first order. Cells that take over there would be strained by what bodies
do not feel: a bar that bends is too long by the square of its slope. So all nodes go by δ first,
the displacement of second order of the whole structure (`rigidfx.shapes.expanded`). Then the cells
of the bodies have the energy of the expansion but for ν, and those beside them little more than
before. A cantilever bent by 0.04, 0.11 and 0.27 of its length, asked for 1 %, errs by 0.5, 0.4 and
0.5 %; where nodes stayed at Φq, by 1.3, 5.0 and 5.1 %. Joints and rigid faces would be torn by δ:
where there are any, nodes stay. Otherwise they go by the part of δ with which the energy is that of
the expansion, as stresses in which a body was frozen do work along δ that no load has done.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rigidfx.base.types import Array
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Structure
from rigidfx.effects.nodes import Instant
from rigidfx.flexible.kernels import integral
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body
from rigidfx.step.equations.actions import Actions
from rigidfx.step.stepper import Stepper
from rigidfx.switch.found_bodies import FoundBodies


class Shift(NamedTuple):
    """How nodes move, and what all but the bodies gain by that.

    Attributes:
        d: Of the owned nodes, shape (nodes, 3) [m].
        energy: Of flexible cells, springs and contacts [J].
        angular_momentum: Of nodes of flexible cells, shape (3,) [kg m²/s].
    """

    d: Array
    energy: float
    angular_momentum: Array


class Leaving:
    """Finds how nodes move where bodies leave their shapes."""

    def __init__(self, stepper: Stepper, found: FoundBodies) -> None:
        """Keep the bodies that were found."""
        self._stepper, self._found = stepper, found

    def shift(self, bodies: Sequence[Body]) -> Shift | None:
        """How nodes move as bodies of the state leave their shapes; None if not. Collective."""
        stepper, own = self._stepper, [body for body in bodies if self._found.grows(body.data)]
        stays = stepper.system.linkage is not None or any(self._found.stiff(b.data) for b in own)
        if stays or not own:
            return None
        d = np.sum([self._found.shortened(body) for body in own], axis=0)
        leaving = {body.data.number for body in bodies}
        for body in stepper.state.bodies:
            if body.data.number not in leaving:
                d[body.data.nodes] = 0.0
        d.reshape(-1)[stepper.system.prescribed.mask] = 0.0  # supports may have begun since
        found, stay, go = self._gained(d, bodies)
        if stay * go < 0:  # between both it is that of the expansion
            found, _, go = self._gained(stay / (stay - go) * d, bodies)
        return found if abs(go) < abs(stay) else None

    def _gained(self, d: Array, bodies: Sequence[Body]) -> tuple[Shift, float, float]:
        """What others gain by displacements of all nodes, and how much energy is too much [J].

        That is where nodes stay, and where they go. Collective.
        """
        energy, momentum = self._stepper.system.energies.gained(self._stepper.state, d)
        stored, before, after = self._energies(d, bodies)
        gained, wanted = energy + stored, float(Bodies.of_each(bodies).strain_of_each.sum())
        return Shift(d, gained, momentum), before - wanted, after + gained - wanted

    def _energies(self, d: Array, bodies: Sequence[Body]) -> Array:
        """What springs and contacts gain, and energy of the bodies' cells before and after [J].

        All nodes have displacements d. Collective.
        """
        scene, state, acting = self._stepper.scene, self._stepper.state, self._stepper.system.acting
        forces = self._stepper.forces
        cells = np.sort(np.concatenate([body.data.cells for body in bodies]))
        strain = forces.bind_energy(forces.cells(cells))
        state.rebuild()
        kept, u, none = state.snapshot(), state.u.x.array, Bodies.of_each(())
        rows = Rows(scene.space, np.arange(len(d), dtype=np.int32))
        structure = Structure(
            scene=scene,
            rows=rows,
            own=np.ones(len(d), dtype=bool),
            bodies=none,
            mass=None,
            u=u,
            surface=forces.surface,
        )
        actions, found = Actions(structure, scene.effects, acting), []
        for way in (0.0 * d, d):
            state.shift(rows.dofs, way.reshape(-1))
            stored = np.sum(actions.stored(Instant(none, u[rows.dofs], state.t)))
            found.append((stored, integral(strain)))
        actions.destroy()
        state.restore(kept)
        (first, before), (last, after) = found
        return np.asarray(scene.sum(np.array([last - first, before, after])))
