"""The judge of a step: what it objects to, and in which order."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem

import rigidfx as rf
from rigidfx.base.errors import InversionError
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.inversion import Inversion
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments, Step
from rigidfx.step.newton.solution import Solution
from rigidfx.step.watches.judge import Attempt, Judge

MATERIAL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
NO_BODIES = Increments(Step(Bodies.of_each(()), 0.125), np.empty((0, 6)))

# Deformation gradients, and whether a body can get there.
ENDS = {
    "rest": (np.eye(3), True),
    "half a turn": (np.diag([-1.0, -1.0, 1.0]), True),
    "mirror image": (np.diag([-1.0, 1.0, 1.0]), False),
    "through a point": (-np.eye(3), False),
    "flat": (np.diag([1.0, 1.0, 0.0]), False),
    "thin": (np.diag([1.0, 1.0, 1e-6]), True),
    "long": (np.diag([9e5, 1.0, 1.0]), True),
    "torn apart": (np.diag([2e6, 1.0, 1.0]), False),
}


def attempt(converged, place=None, residuals=(3.0, 0.5)):
    """An attempt from 0.25 s on."""
    reason = "tolerance met" if converged else "too many iterations"
    solution = Solution(converged, reason, residuals, 1, 1, "LU", place, 0.0, 0.0, 0.0)
    return Attempt(0.25, 0.125, solution, 0.375, NO_BODIES)


class Look:
    """Looks for inverted cells in two unit cells, and counts how often it is asked."""

    def __init__(self, gradients):
        scene = self.scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), MATERIAL)
        forces = InternalForces(scene, fem.Function(scene.space))
        self.inversion = Inversion(scene, forces)
        self.inversion.bind(forces.cells())
        X = scene.space.tabulate_dof_coordinates()
        F = np.where((X[:, 0] > 1 + 1e-9)[:, None, None], gradients[1], gradients[0])
        x = np.einsum("nij,nj->ni", F, X - [1, 0, 0])
        forces.u1.x.array[:] = (x - X).reshape(-1)
        self.times = 0

    @property
    def judge(self):
        return Judge(self.scene, self)

    def find(self):
        self.times += 1
        return self.inversion.find()


@pytest.mark.parametrize("end", ENDS)
def test_what_turns_cells_inside_out_is_objected_to(end):
    """Any rotation and any stretch below 10⁶ may become the state."""
    F, possible = ENDS[end]
    objection = Look([F, F]).judge.objection(attempt(converged=True))
    assert possible == (objection is None)
    assert possible or isinstance(objection, InversionError)


def test_residuals_that_are_not_finite():
    """There is neither a list of them nor a place."""
    judge = Look([np.eye(3)] * 2).judge
    text = str(judge.objection(attempt(converged=False, residuals=())))
    assert "not finite N" in text
    assert "X = " not in text
