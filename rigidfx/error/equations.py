"""The matrices of the error's equation about a shape, over all cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.coupling.rows import Rows
from rigidfx.effects import Rigid
from rigidfx.error.frames import Frames
from rigidfx.error.loose import Loose, loose_parts
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.shadow.ground import ground_of
from rigidfx.shadow.linear_motion import LinearMotion
from rigidfx.shadow.parts import mass_of
from rigidfx.step.stepper import Stepper

__all__ = ["about"]

Bools = npt.NDArray[np.bool_]


def about(
    stepper: Stepper, forms: LinearForms, frames: Frames, held: Bools
) -> tuple[LinearMotion, Loose]:
    """M, C and K of all cells about a shape, with springs; parts named rigid are stiff. Collective.

    Args:
        stepper: Knows the forces of the run.
        forms: Linear forms, which get the shape.
        frames: The shape.
        held: Which owned dofs supports hold.

    Returns:
        The equations, and the rigid motions that nothing holds.
    """
    places = frames.shape
    scene, forces, shape = stepper.scene, stepper.forces, forms.shape.x
    rows = Rows(scene.space, np.arange(len(places), dtype=np.int32))
    owned = scene.mesh.topology.index_map(scene.mesh.topology.dim).size_local
    cells = forces.cells(np.arange(owned, dtype=np.int32))
    shape.array[: places.size] = (places - stepper.state.X[: len(places)]).reshape(-1)
    shape.scatter_forward()
    mass, ground = mass_of(scene, rows, cells), ground_of(scene, rows)
    named = [scene.owned_cells(part.where, part.kind) for part in scene.named(Rigid)]
    rigid = forces.cells(np.unique(np.concatenate(named)).astype(np.int32)) if named else None
    supported = np.flatnonzero(held)
    motion = LinearMotion(rows, cells, forms, mass, supported, ground=ground, rigid=rigid)
    springs = None if ground is None else ground.K
    return motion, loose_parts(scene, frames, held, springs, motion.matrices[1])
